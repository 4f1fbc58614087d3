defmodule BB.Bus.Sim.Source do
  @moduledoc """
  The quantities that a simulated chip measures, from its option `:source`.

  Models of chips use it. The option is one of

  - a map or keyword list of quantities that do not change, such as `[voltage: 11.1]`. The others
    have their defaults;
  - a function of the seconds since power-on that returns such a list, such as
    `fn seconds -> [voltage: 12.6 - 0.01 * seconds] end`. It can read an `Agent`, an ETS table or
    `:counters`, so that a test changes a quantity while the chip runs.

  The module is pure.

      iex> defaults = %{angle: 0.0, magnet: :good}
      iex> source = BB.Bus.Sim.Source.new(fn seconds -> [angle: seconds / 2] end, defaults)
      iex> BB.Bus.Sim.Source.at(source, 3)
      %{angle: 1.5, magnet: :good}
  """

  @typedoc "A source."
  @opaque t :: {defaults :: map(), (number() -> Enumerable.t())}

  @typedoc "The option `:source`."
  @type spec :: map() | keyword() | (number() -> map() | keyword())

  @doc """
  Returns the source of an option. `defaults` has all quantities.

  Raises `ArgumentError` for a wrong option.
  """
  @spec new(spec(), map()) :: t()
  def new(function, defaults) when is_function(function, 1), do: {defaults, function}

  def new(quantities, defaults) when is_map(quantities) or is_list(quantities) do
    _ = merge!(quantities, defaults)
    {defaults, fn _seconds -> quantities end}
  end

  def new(other, _defaults) do
    raise ArgumentError,
          "expected a source: quantities, or a function of time that returns them, " <>
            "got: #{inspect(other)}"
  end

  @doc "Returns the quantities at a time, `seconds` after power-on."
  @spec at(t(), number()) :: map()
  def at({defaults, function}, seconds), do: merge!(function.(seconds), defaults)

  defp merge!(quantities, defaults) do
    Enum.reduce(quantities, defaults, fn
      {key, value}, all when is_map_key(all, key) -> %{all | key => value}
      other, _all -> raise ArgumentError, unknown(other, defaults)
    end)
  end

  defp unknown(other, defaults) do
    names = defaults |> Map.keys() |> Enum.sort() |> Enum.map_join(", ", &inspect/1)
    "expected a source of #{names}, got: #{inspect(other)}"
  end
end

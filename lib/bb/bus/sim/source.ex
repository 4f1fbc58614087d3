defmodule BB.Bus.Sim.Source do
  @moduledoc """
  What a simulated chip measures: quantities that a test or a person sets. Pure.

  - a map or keyword list: these quantities, the others as by default, for ever;
  - a function of the seconds since power-on that returns such a list, for what changes. One that reads an `Agent`, an ETS table
    or `:counters` is a knob to turn while the chip is running.

  For example `source: [voltage: 11.1]`, or `source: fn seconds -> [voltage: 12.6 - 0.01 * seconds] end`.
  """

  @opaque t :: {defaults :: map(), (number() -> Enumerable.t())}

  @typedoc "As written in the device's options."
  @type spec :: map() | keyword() | (number() -> map() | keyword())

  @doc "A source from the device's option, with all its quantities in `defaults`. Raises `ArgumentError` when it is wrong."
  @spec new(spec(), map()) :: t()
  def new(function, defaults) when is_function(function, 1), do: {defaults, function}

  def new(quantities, defaults) when is_map(quantities) or is_list(quantities) do
    _ = merge!(quantities, defaults)
    {defaults, fn _seconds -> quantities end}
  end

  def new(other, _defaults) do
    raise ArgumentError,
          "expected a source: quantities, or a function of time that returns some, got: #{inspect(other)}"
  end

  @doc """
  The quantities at a time, `seconds` after power-on.

      iex> source = BB.Bus.Sim.Source.new(fn seconds -> [angle: seconds / 2] end, %{angle: 0.0, magnet: :good})
      iex> BB.Bus.Sim.Source.at(source, 3)
      %{angle: 1.5, magnet: :good}
  """
  @spec at(t(), number()) :: map()
  def at({defaults, function}, seconds), do: merge!(function.(seconds), defaults)

  defp merge!(quantities, defaults) do
    Enum.reduce(quantities, defaults, fn
      {key, value}, all when is_map_key(all, key) -> %{all | key => value}
      other, _all -> raise ArgumentError, unknown(other, defaults)
    end)
  end

  defp unknown(other, defaults),
    do:
      "expected a source of #{defaults |> Map.keys() |> Enum.sort() |> Enum.map_join(", ", &inspect/1)}, got: #{inspect(other)}"
end

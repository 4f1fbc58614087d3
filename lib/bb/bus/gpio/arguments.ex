defmodule BB.Bus.GPIO.Arguments do
  @moduledoc """
  Checks the arguments of GPIO functions, in the words of `Circuits.GPIO`.

  `BB.Bus.Linux.GPIO` and `BB.Bus.Sim.GPIO` use it, so that both accept the same calls. A function
  with `!` returns its argument, or raises `ArgumentError`.

      iex> BB.Bus.GPIO.Arguments.spec!({"gpiochip0", 17})
      {"gpiochip0", 17}
      iex> BB.Bus.GPIO.Arguments.one_chip([{:ok, {"gpiochip0", 5}}, {:ok, {"gpiochip1", 6}}])
      {:error, :multiple_controllers}
  """

  @pulls [:not_set, :none, :pullup, :pulldown]
  @drives [:push_pull, :open_drain, :open_source]
  @triggers [:rising, :falling, :both, :none]
  @most_lines 64
  @most_levels 0xFFFF_FFFF_FFFF_FFFF
  @greatest_line 0x7FFF_FFFF
  @defaults [initial_value: 0, pull_mode: :not_set, drive_mode: :push_pull, on_busy: :error]

  @typedoc "An index over all lines, a chip and a line, a label, or a chip and a label."
  @type spec :: non_neg_integer() | {String.t(), non_neg_integer() | String.t()} | String.t()

  @typedoc "A chip and a line."
  @type location :: {String.t(), non_neg_integer()}

  @typedoc "The names of a line. Its `:location` is an unambiguous `t:spec/0`."
  @type identifiers :: %{location: location(), controller: String.t(), label: String.t()}

  @doc "Returns whether a term looks like a `t:spec/0`."
  defguard is_spec(x)
           when (is_tuple(x) and is_binary(elem(x, 0)) and
                   (is_binary(elem(x, 1)) or is_integer(elem(x, 1)))) or is_binary(x) or
                  is_integer(x)

  @doc "Checks the spec of a line."
  @spec spec!(term()) :: spec()
  def spec!({chip, line} = spec)
      when is_binary(chip) and is_integer(line) and abs(line) <= @greatest_line,
      do: spec

  def spec!({chip, label} = spec) when is_binary(chip) and is_binary(label), do: spec
  def spec!(spec) when is_binary(spec) or is_integer(spec), do: spec
  def spec!(spec), do: raise(ArgumentError, "Invalid GPIO spec: #{inspect(spec)}")

  @doc "Checks the specs of a group of lines."
  @spec group!([term()]) :: [spec()]
  def group!([]), do: raise(ArgumentError, "Expected a non-empty list of GPIO specs")

  def group!(specs) when length(specs) > @most_lines,
    do: raise(ArgumentError, "A GPIO group is limited to #{@most_lines} lines")

  def group!(specs), do: Enum.map(specs, &spec!/1)

  @doc "Checks a direction."
  @spec direction!(term()) :: :input | :output
  def direction!(direction) when direction in [:input, :output], do: direction

  def direction!(other) do
    raise ArgumentError, "Invalid direction: #{inspect(other)}. Options are :input or :output"
  end

  @doc "Checks which edges to send."
  @spec trigger!(term()) :: :rising | :falling | :both | :none
  def trigger!(trigger) when trigger in @triggers, do: trigger
  def trigger!(other), do: refuse("a trigger", @triggers, other)

  @doc "Checks a pull mode."
  @spec pull!(term()) :: :not_set | :none | :pullup | :pulldown
  def pull!(pull) when pull in @pulls, do: pull
  def pull!(other), do: refuse("a pull mode", @pulls, other)

  @doc "Checks a drive mode."
  @spec drive!(term()) :: :push_pull | :open_drain | :open_source
  def drive!(drive) when drive in @drives, do: drive
  def drive!(other), do: refuse("a drive mode", @drives, other)

  @doc "Checks levels, one bit for each line."
  @spec levels!(term()) :: non_neg_integer()
  def levels!(levels) when is_integer(levels) and levels >= 0 and levels <= @most_levels,
    do: levels

  def levels!(other) do
    raise ArgumentError,
          "expected a value of 0 or 1, or a bit for each line, got: #{inspect(other)}"
  end

  @doc "Checks the options of `open/3`, and adds the defaults."
  @spec options!(keyword()) :: keyword()
  def options!(opts) do
    for {key, value} <- opts, expected = expected(key, value), do: raise(ArgumentError, expected)

    # Circuits 1 had the value :not_set, and Circuits 2 accepts it.
    @defaults
    |> Keyword.merge(opts)
    |> Keyword.update!(:initial_value, &if(&1 == :not_set, do: 0, else: &1))
  end

  @doc "Returns the process of the option `:receiver`, otherwise the caller."
  @spec receiver(keyword()) :: pid()
  def receiver(opts) do
    case Keyword.get(opts, :receiver) do
      pid when is_pid(pid) -> pid
      name when is_atom(name) and name != nil -> Process.whereis(name) || self()
      _other -> self()
    end
  end

  @doc "Returns the spec of a line, which can also be given by its identifiers."
  @spec plain(spec() | identifiers()) :: spec()
  def plain(%{location: spec}), do: spec
  def plain(spec), do: spec

  @doc "Returns the identifiers of the line that a spec means, or `nil`."
  @spec find(term(), [identifiers()]) :: identifiers() | nil
  def find(index, lines) when is_integer(index) and index >= 0, do: Enum.at(lines, index)
  def find(label, lines) when is_binary(label), do: Enum.find(lines, &(&1.label == label))

  def find({controller, at}, lines) do
    Enum.find(lines, fn %{location: {chip, offset}} = line ->
      controller in [chip, line.controller] and at in [offset, line.label]
    end)
  end

  def find(_spec, _lines), do: nil

  @doc "Returns the chip and the lines of a group, which must be different lines of one chip."
  @spec one_chip([{:ok, location()} | {:error, atom()}]) ::
          {:ok, String.t(), [non_neg_integer()]} | {:error, atom()}
  def one_chip(located) do
    with nil <- Enum.find(located, &match?({:error, _}, &1)) do
      {chips, offsets} = located |> Enum.map(&elem(&1, 1)) |> Enum.unzip()

      cond do
        length(Enum.uniq(chips)) > 1 -> {:error, :multiple_controllers}
        offsets != Enum.uniq(offsets) -> {:error, :duplicate_lines}
        true -> {:ok, hd(chips), offsets}
      end
    end
  end

  defp expected(:initial_value, value)
       when value == :not_set or (is_integer(value) and value >= 0 and value <= @most_levels),
       do: nil

  defp expected(:initial_value, _value),
    do: ":initial_value should be 0 or 1 (or an integer with one bit per line for a group)"

  defp expected(:pull_mode, value) when value not in @pulls,
    do: ":pull_mode should be :not_set, :pullup, :pulldown, or :none"

  defp expected(:drive_mode, value) when value not in @drives,
    do: ":drive_mode should be :push_pull, :open_drain, or :open_source"

  defp expected(:on_busy, value) when value not in [:take_over, :error],
    do: ":on_busy should be :take_over or :error"

  defp expected(_key, _value), do: nil

  defp refuse(kind, accepted, got) do
    raise ArgumentError,
          "expected #{kind} (#{Enum.map_join(accepted, ", ", &inspect/1)}), got: #{inspect(got)}"
  end
end

defmodule BB.Bus.Linux.GPIO.Arguments do
  @moduledoc """
  What a caller of `BB.Bus.Linux.GPIO` may say. Each function returns what it was given, or raises
  `ArgumentError`.
  """

  @pulls [:not_set, :none, :pullup, :pulldown]
  @drives [:push_pull, :open_drain, :open_source]
  @triggers [:rising, :falling, :both, :none]
  @most_lines 64
  @most_levels 0xFFFF_FFFF_FFFF_FFFF
  @greatest_line 0x7FFF_FFFF
  @defaults [initial_value: 0, pull_mode: :not_set, drive_mode: :push_pull, on_busy: :error]

  @doc "A line."
  @spec spec!(term()) :: BB.Bus.Linux.GPIO.gpio_spec()
  def spec!({chip, line} = spec)
      when is_binary(chip) and is_integer(line) and abs(line) <= @greatest_line,
      do: spec

  def spec!({chip, label} = spec) when is_binary(chip) and is_binary(label), do: spec
  def spec!(spec) when is_binary(spec) or is_integer(spec), do: spec
  def spec!(spec), do: raise(ArgumentError, "Invalid GPIO spec: #{inspect(spec)}")

  @doc "A group of lines."
  @spec group!([term()]) :: [BB.Bus.Linux.GPIO.gpio_spec()]
  def group!([]), do: raise(ArgumentError, "Expected a non-empty list of GPIO specs")

  def group!(specs) when length(specs) > @most_lines,
    do: raise(ArgumentError, "A GPIO group is limited to #{@most_lines} lines")

  def group!(specs), do: Enum.map(specs, &spec!/1)

  @doc "A direction."
  @spec direction!(term()) :: :input | :output
  def direction!(direction) when direction in [:input, :output], do: direction

  def direction!(other) do
    raise ArgumentError, "Invalid direction: #{inspect(other)}. Options are :input or :output"
  end

  @doc "Which edges."
  @spec trigger!(term()) :: :rising | :falling | :both | :none
  def trigger!(trigger) when trigger in @triggers, do: trigger
  def trigger!(other), do: refuse("a trigger", @triggers, other)

  @doc "A pull."
  @spec pull!(term()) :: :not_set | :none | :pullup | :pulldown
  def pull!(pull) when pull in @pulls, do: pull
  def pull!(other), do: refuse("a pull mode", @pulls, other)

  @doc "A way to drive."
  @spec drive!(term()) :: :push_pull | :open_drain | :open_source
  def drive!(drive) when drive in @drives, do: drive
  def drive!(other), do: refuse("a drive mode", @drives, other)

  @doc "Levels, a bit each."
  @spec levels!(term()) :: non_neg_integer()
  def levels!(levels) when is_integer(levels) and levels >= 0 and levels <= @most_levels,
    do: levels

  def levels!(other),
    do:
      raise(
        ArgumentError,
        "expected a value of 0 or 1, or a bit for each line, got: #{inspect(other)}"
      )

  @doc "The options of `open/3`, with the defaults."
  @spec options!(keyword()) :: keyword()
  def options!(opts) do
    for {key, value} <- opts, expected = expected(key, value), do: raise(ArgumentError, expected)

    # As Circuits 1 had it, and 2 still takes it.
    @defaults
    |> Keyword.merge(opts)
    |> Keyword.update!(:initial_value, &if(&1 == :not_set, do: 0, else: &1))
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

  defp refuse(what, accepted, got) do
    raise ArgumentError,
          "expected #{what} (#{Enum.map_join(accepted, ", ", &inspect/1)}), got: #{inspect(got)}"
  end
end

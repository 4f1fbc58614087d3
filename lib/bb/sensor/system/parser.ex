defmodule BB.Sensor.System.Parser do
  @moduledoc """
  Parses the kernel's files that `BB.Sensor.System` reads.

  Each function returns the fields of a `BB.Message.System.Status`, or `:error` for a text of
  another format. The module is pure.

      iex> BB.Sensor.System.Parser.temperature("48312\\n")
      {:ok, %{temperature: 48.312}}
  """

  # Bits of the Raspberry Pi's firmware, as `vcgencmd get_throttled` shows them: the causes now,
  # and 16 bits higher the causes since the start.
  @causes [:under_voltage, :frequency_capped, :throttled, :soft_temperature_limit]

  @doc """
  Parses a thermal zone's `temp`: thousandths of a degree.

      iex> BB.Sensor.System.Parser.temperature("48312\\n")
      {:ok, %{temperature: 48.312}}
      iex> BB.Sensor.System.Parser.temperature("")
      :error
  """
  @spec temperature(String.t()) :: {:ok, %{temperature: float()}} | :error
  def temperature(text) do
    with {thousandths, "\n"} <- Integer.parse(text),
         do: {:ok, %{temperature: thousandths / 1000}},
         else: (_ -> :error)
  end

  @doc """
  Parses `get_throttled` of the Raspberry Pi: a hexadecimal number. Its bits 0 to 3 are the causes
  now, its bits 16 to 19 those since the start.

      iex> BB.Sensor.System.Parser.throttling("50005\\n")
      {:ok,
       %{
         throttling: [:under_voltage, :throttled],
         throttled_before: [:under_voltage, :throttled]
       }}
      iex> BB.Sensor.System.Parser.throttling("80000\\n")
      {:ok, %{throttling: [], throttled_before: [:soft_temperature_limit]}}
  """
  @spec throttling(String.t()) ::
          {:ok, %{throttling: [atom()], throttled_before: [atom()]}} | :error
  def throttling(text) do
    with {bits, "\n"} <- text |> String.replace_prefix("0x", "") |> Integer.parse(16),
         do: {:ok, %{throttling: causes(bits, 0), throttled_before: causes(bits, 16)}},
         else: (_ -> :error)
  end

  defp causes(bits, from) do
    for {cause, bit} <- Enum.with_index(@causes, from),
        Bitwise.band(bits, Bitwise.bsl(1, bit)) != 0,
        do: cause
  end

  @doc """
  Parses `/proc/meminfo`: MemTotal and MemAvailable, in bytes.

      iex> text = "MemTotal: 3884360 kB\\nMemFree: 1 kB\\nMemAvailable: 3500000 kB\\n"
      iex> BB.Sensor.System.Parser.memory(text)
      {:ok, %{memory_total: 3_977_584_640, memory_available: 3_584_000_000}}
  """
  @spec memory(String.t()) ::
          {:ok, %{memory_total: pos_integer(), memory_available: non_neg_integer()}} | :error
  def memory(text) do
    with {:ok, total} <- kilobytes(text, "MemTotal"),
         {:ok, available} <- kilobytes(text, "MemAvailable"),
         do: {:ok, %{memory_total: total * 1024, memory_available: available * 1024}}
  end

  defp kilobytes(text, name) do
    case Regex.run(~r/^#{name}:\s*(\d+) kB$/m, text) do
      [_, number] -> {:ok, String.to_integer(number)}
      nil -> :error
    end
  end

  @doc """
  Parses `/proc/loadavg`: its first three numbers.

      iex> BB.Sensor.System.Parser.load("0.52 0.58 0.59 1/389 14321\\n")
      {:ok, %{load_1_min: 0.52, load_5_min: 0.58, load_15_min: 0.59}}
  """
  @spec load(String.t()) ::
          {:ok, %{load_1_min: float(), load_5_min: float(), load_15_min: float()}} | :error
  def load(text) do
    with [one, five, fifteen | _] <- String.split(text),
         [{one, ""}, {five, ""}, {fifteen, ""}] <- Enum.map([one, five, fifteen], &Float.parse/1),
         do: {:ok, %{load_1_min: one, load_5_min: five, load_15_min: fifteen}},
         else: (_ -> :error)
  end

  @doc """
  Parses `/sys/devices/system/cpu/online`: the number of processors in its ranges.

      iex> BB.Sensor.System.Parser.processors("0-3\\n")
      {:ok, %{processors: 4}}
      iex> BB.Sensor.System.Parser.processors("0,2-3\\n")
      {:ok, %{processors: 3}}
  """
  @spec processors(String.t()) :: {:ok, %{processors: pos_integer()}} | :error
  def processors(text) do
    if text =~ ~r/^\d+(-\d+)?(,\d+(-\d+)?)*\n$/,
      do: {:ok, %{processors: text |> String.trim() |> String.split(",") |> count()}},
      else: :error
  end

  defp count(ranges) do
    Enum.reduce(ranges, 0, fn range, sum ->
      [first | rest] = range |> String.split("-") |> Enum.map(&String.to_integer/1)
      sum + (List.first(rest) || first) - first + 1
    end)
  end
end

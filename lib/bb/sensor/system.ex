defmodule BB.Sensor.System do
  alias BB.Sensor.Polled

  @schema Polled.options(rate: {0.01, 10}, default: 1) ++
            [
              thermal_zone: [
                type: {:or, [:string, nil]},
                default: nil,
                doc: """
                The type of the thermal zone to read, as in \
                `/sys/class/thermal/thermal_zone*/type`. `nil` is the processor's zone: \
                `cpu-thermal`, `cpu_thermal`, `soc-thermal`, `x86_pkg_temp` or `coretemp`, or \
                else the first zone.
                """
              ],
              root: [
                type: :string,
                default: "/",
                doc: "The folder that contains `proc` and `sys`; tests set another one."
              ]
            ]

  @moduledoc """
  A sensor of the robot's computer: temperature and throttling of the processor, memory, and load.

  Declare it to see a computer that is hot, throttled or out of memory:

      sensor :board, BB.Sensor.System

  It publishes `BB.Message.System.Status`.

  ## Options

  #{BB.Options.docs(@schema)}

  ## Files

  | file | value |
  |---|---|
  | `/proc/meminfo` | total and available memory |
  | `/proc/loadavg` | load |
  | `/sys/devices/system/cpu/online` | processors |
  | `/sys/class/thermal/thermal_zone*/temp` | temperature, if the board has a zone |
  | `/sys/devices/platform/soc/soc:firmware/get_throttled` | throttling, on a Raspberry Pi |

  The sensor reads the files that exist when it starts for each message. A file that fails later
  is a failed reading (`BB.Sensor.Polled`), not a missing value.
  """

  use Polled, options_schema: @schema

  alias BB.Message
  alias BB.Message.System.Status
  alias BB.Sensor.System.Parser

  @thermal "sys/class/thermal"
  # On newer boards the name of the soc includes its address.
  @throttling "sys/devices/platform/soc*/soc*firmware/get_throttled"
  @processor_zones ~w(cpu-thermal cpu_thermal soc-thermal x86_pkg_temp coretemp)

  @typedoc """
  The reason of a failure: a file that could not be read, with the error of `File.read/1`; a file
  of an unexpected format, with its text; or a thermal zone that does not exist, with the types of
  those that do.
  """
  @type reason ::
          {:unreadable, Path.t(), File.posix()}
          | {:unexpected, Path.t(), String.t()}
          | {:no_thermal_zone, String.t(), [String.t()]}

  @doc """
  Formats a reason as a sentence that says what to check.

      iex> BB.Sensor.System.explain({:unreadable, "/proc/meminfo", :enoent})
      "/proc/meminfo cannot be read: no such file or directory"
      iex> BB.Sensor.System.explain({:no_thermal_zone, "gpu", ["cpu-thermal"]})
      "thermal zone gpu does not exist: the board has cpu-thermal"
  """
  @impl BB.Sensor
  @spec explain(reason()) :: String.t()
  def explain({:unreadable, path, posix}),
    do: "#{path} cannot be read: #{:file.format_error(posix)}"

  def explain({:unexpected, path, text}),
    do: "expected numbers in #{path}, got: #{inspect(text, printable_limit: 80)}"

  def explain({:no_thermal_zone, type, []}),
    do: "thermal zone #{type} does not exist: the board has none"

  def explain({:no_thermal_zone, type, types}),
    do: "thermal zone #{type} does not exist: the board has #{Enum.join(types, ", ")}"

  @impl Polled
  def open(opts) do
    root = opts[:root]

    with {:ok, thermal} <- thermal_files(root, opts[:thermal_zone]) do
      files =
        [
          {Path.join(root, "proc/meminfo"), &Parser.memory/1},
          {Path.join(root, "proc/loadavg"), &Parser.load/1},
          {Path.join(root, "sys/devices/system/cpu/online"), &Parser.processors/1}
        ] ++ thermal ++ throttling_files(root)

      # A file that cannot be read from the start keeps the sensor down.
      with {:ok, _status, files} <- measure(files, 0), do: {:ok, files}
    end
  end

  defp throttling_files(root) do
    for path <- root |> Path.join(@throttling) |> Path.wildcard() |> Enum.take(1),
        do: {path, &Parser.throttling/1}
  end

  # The order of the zones is by number: 2 before 10.
  defp thermal_files(root, wanted) do
    zones =
      [root, @thermal, "thermal_zone*"]
      |> Path.join()
      |> Path.wildcard()
      |> Enum.sort_by(&{byte_size(&1), &1})
      |> Enum.map(fn zone ->
        {read_type(zone), [{Path.join(zone, "temp"), &Parser.temperature/1}]}
      end)

    choose_zone(zones, wanted)
  end

  defp read_type(zone) do
    case File.read(Path.join(zone, "type")) do
      {:ok, type} -> String.trim(type)
      {:error, _posix} -> ""
    end
  end

  defp choose_zone([], nil), do: {:ok, []}

  defp choose_zone([{_type, first} | _] = zones, nil) do
    {:ok, Enum.find_value(@processor_zones, first, fn type -> find(zones, type) end)}
  end

  defp choose_zone(zones, wanted) do
    case find(zones, wanted) do
      nil -> {:error, {:no_thermal_zone, wanted, Enum.map(zones, &elem(&1, 0))}}
      files -> {:ok, files}
    end
  end

  defp find(zones, type), do: with({_type, files} <- List.keyfind(zones, type, 0), do: files)

  @impl Polled
  def measure(files, _now_ns) do
    result =
      Enum.reduce_while(files, %{}, fn file, status ->
        case read(file) do
          {:ok, more} -> {:cont, Map.merge(status, more)}
          {:error, reason} -> {:halt, {:error, reason}}
        end
      end)

    with %{} = status <- result, do: {:ok, status, files}
  end

  defp read({path, parse}) do
    case File.read(path) do
      {:ok, text} -> with(:error <- parse.(text), do: {:error, {:unexpected, path, text}})
      {:error, posix} -> {:error, {:unreadable, path, posix}}
    end
  end

  @impl Polled
  def publish(status, sensor),
    do: BB.Sensor.publish(sensor.bb, Message.new!(Status, sensor.frame_id, status))

  @impl Polled
  def close(_files), do: :ok
end

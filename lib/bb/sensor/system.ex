defmodule BB.Sensor.System do
  alias BB.Sensor.Polled

  @schema Polled.options(rate: {0.01, 10}, default: 1) ++
            [
              thermal_zone: [
                type: {:or, [:string, nil]},
                default: nil,
                doc:
                  "The type of the thermal zone whose temperature counts, as `/sys/class/thermal/thermal_zone*/type` has it. When `nil`, the processor's: " <>
                    "`cpu-thermal`, `cpu_thermal`, `soc-thermal`, `x86_pkg_temp` or `coretemp`, or else the first."
              ],
              root: [
                type: :string,
                default: "/",
                doc: "The folder in which `proc` and `sys` are; another one in tests."
              ]
            ]

  @moduledoc """
  The computer that the robot runs on: processor temperature and throttling, memory, load, from the kernel's files.

      sensor :board, BB.Sensor.System

  Publishes `BB.Message.System.Status`.

  ## Options

  #{BB.Options.docs(@schema)}

  ## Files

  | file | gives |
  |---|---|
  | `/proc/meminfo` | total and available memory |
  | `/proc/loadavg` | load |
  | `/sys/devices/system/cpu/online` | processors |
  | `/sys/class/thermal/thermal_zone*/temp` | temperature, where there is one |
  | `/sys/devices/platform/soc/soc:firmware/get_throttled` | throttling, on a Raspberry Pi |

  What is there when the sensor starts is read with each message. A file that then fails is a failed reading (`BB.Sensor.Polled`), not a
  missing value.
  """

  use Polled, options_schema: @schema

  alias BB.Message
  alias BB.Message.System.Status
  alias BB.Sensor.System.Parser

  @thermal "sys/class/thermal"
  # The name of the soc has its address on newer boards.
  @throttling "sys/devices/platform/soc*/soc*firmware/get_throttled"
  @processor_zones ~w(cpu-thermal cpu_thermal soc-thermal x86_pkg_temp coretemp)

  @typedoc """
  Why the sensor does not work: a file that could not be read, with the error of `File.read/1`; one that says something unexpected; a
  thermal zone that was asked for and is not there, and those that are.
  """
  @type reason ::
          {:unreadable, Path.t(), File.posix()}
          | {:unexpected, Path.t(), String.t()}
          | {:no_thermal_zone, String.t(), [String.t()]}

  @doc """
  A reason in a sentence that says what to look at.

      iex> BB.Sensor.System.explain({:unreadable, "/proc/meminfo", :enoent})
      "/proc/meminfo cannot be read: no such file or directory"
      iex> BB.Sensor.System.explain({:no_thermal_zone, "gpu", ["cpu-thermal"]})
      "there is no thermal zone of type gpu: there are cpu-thermal"
  """
  @impl BB.Sensor
  @spec explain(reason()) :: String.t()
  def explain({:unreadable, path, posix}),
    do: "#{path} cannot be read: #{:file.format_error(posix)}"

  def explain({:unexpected, path, text}),
    do: "#{path} says something unexpected: #{inspect(text, printable_limit: 80)}"

  def explain({:no_thermal_zone, type, []}),
    do: "there is no thermal zone of type #{type}: there is none at all"

  def explain({:no_thermal_zone, type, types}),
    do: "there is no thermal zone of type #{type}: there are #{Enum.join(types, ", ")}"

  @impl Polled
  def open(opts) do
    root = opts[:root]

    with {:ok, thermal} <- thermal(root, opts[:thermal_zone]) do
      files =
        [
          {Path.join(root, "proc/meminfo"), &Parser.memory/1},
          {Path.join(root, "proc/loadavg"), &Parser.load/1},
          {Path.join(root, "sys/devices/system/cpu/online"), &Parser.processors/1}
        ] ++ thermal ++ throttling(root)

      # What cannot be read at all is the start's fault.
      with {:ok, _status, files} <- measure(files, 0), do: {:ok, files}
    end
  end

  defp throttling(root) do
    for path <- root |> Path.join(@throttling) |> Path.wildcard() |> Enum.take(1),
        do: {path, &Parser.throttling/1}
  end

  # Zones are read in their order: 2 before 10.
  defp thermal(root, wanted) do
    zones =
      [root, @thermal, "thermal_zone*"]
      |> Path.join()
      |> Path.wildcard()
      |> Enum.sort_by(&{byte_size(&1), &1})
      |> Enum.map(fn zone -> {type(zone), [{Path.join(zone, "temp"), &Parser.temperature/1}]} end)

    choose(zones, wanted)
  end

  defp type(zone) do
    case File.read(Path.join(zone, "type")) do
      {:ok, type} -> String.trim(type)
      {:error, _posix} -> ""
    end
  end

  defp choose([], nil), do: {:ok, []}

  defp choose([{_type, first} | _] = zones, nil) do
    {:ok, Enum.find_value(@processor_zones, first, fn type -> find(zones, type) end)}
  end

  defp choose(zones, wanted) do
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

defmodule BB.Sensor.NativeProcess do
  @schema BB.Options.new!(
            program: [
              type: :string,
              required: true,
              doc:
                "One of the programs in the application's `priv/bin`, a path, or a name to be found in `PATH`."
            ],
            topics: [
              type: :keyword_list,
              default: [],
              doc:
                "The ring topics that it works with, given to it as options: `frames: \"camera\"` becomes `--frames camera`."
            ],
            args: [
              type: {:or, [{:list, :string}, {:tuple, [:atom, :atom, {:list, :any}]}]},
              default: [],
              doc:
                "Further arguments, or `{module, function, arguments}` that gives them at each start."
            ],
            env: [
              type: {:list, {:tuple, [:string, :string]}},
              default: [],
              doc: "Environment variables on top of the BEAM's own."
            ],
            grace_ms: [
              type: {:in, 0..10_000},
              default: 500,
              doc: "Milliseconds between SIGTERM and SIGKILL when it is stopped."
            ],
            nice: [
              type: {:in, 0..19},
              default: 5,
              doc:
                "How much it gives way to other processes; the BEAM, with the sensors' own deadlines, runs at 0."
            ],
            log_level: [
              type: {:in, [:debug, :info, :notice, :warning, :error]},
              default: :info,
              doc: "Level at which its output is logged."
            ]
          )

  @moduledoc """
  An operating-system process in the sensor tree: a camera, a detector, anything that speaks through the ring.

      sensor :tags, {BB.Sensor.NativeProcess, program: "vision_tags", topics: [frames: "camera", detections: "tags"]}

  It starts with its sensor and is restarted as any sensor is, by backoff. Each line that it prints, on standard output or error, is
  logged under the sensor's name. What it measures goes through ring topics; `BB.Handoff.Inlet` brings a topic onto the pubsub.

  **No orphan is left**, however the BEAM ends: the process runs under `process_guard`, which ends it, and everything that it started,
  as soon as its sensor stops, or the pipe to the BEAM closes, as it does when the BEAM is killed by `SIGKILL`.

  The sensor stops with one of these reasons, which its `BB.Message.Sensor.Status` shows: `{:program_not_found, name}`,
  `{:exit_status, n}` (128 + the signal's number when a signal ended it; 127 when it could not be run).

  ## Options

  #{BB.Options.docs(@schema)}
  """

  use BB.Sensor, options_schema: @schema

  require Logger

  @guard "process_guard"
  # Beyond the grace, the guard needs as long as the kernel takes to end what it kills.
  @kill_limit_ms 2_000
  @longest_line 4_096

  @doc """
  A reason in words.

      iex> BB.Sensor.NativeProcess.explain({:exit_status, 137})
      "its program was ended by signal 9"
      iex> BB.Sensor.NativeProcess.explain({:exit_status, 1})
      "its program ended with status 1; what it said is in the log"
  """
  @impl BB.Sensor
  def explain({:program_not_found, name}),
    do: "there is no program #{name}: it is neither in priv/bin nor in PATH"

  def explain({:exit_status, 127}), do: "its program cannot be run; the log says why"

  def explain({:exit_status, status}) when status > 128,
    do: "its program was ended by signal #{status - 128}"

  def explain({:exit_status, status}),
    do: "its program ended with status #{status}; what it said is in the log"

  @impl BB.Sensor
  def init(opts) do
    name = List.last(opts[:bb].path)

    case find_program(opts[:program]) do
      {:ok, program} ->
        {:ok,
         %{
           port: start(program, opts),
           name: name,
           level: opts[:log_level],
           grace_ms: opts[:grace_ms],
           line: []
         }}

      :error ->
        {:stop, {:program_not_found, opts[:program]}}
    end
  end

  @impl BB.Sensor
  def handle_info({port, {:data, {:noeol, part}}}, %{port: port} = state) do
    {:noreply, %{state | line: [state.line, part]}}
  end

  def handle_info({port, {:data, {:eol, part}}}, %{port: port} = state) do
    Logger.log(state.level, fn -> [to_string(state.name), ": ", state.line, part] end)
    {:noreply, %{state | line: []}}
  end

  def handle_info({port, {:exit_status, status}}, %{port: port} = state) do
    {:stop, {:shutdown, {:exit_status, status}}, %{state | port: nil}}
  end

  def handle_info(_other, state), do: {:noreply, state}

  @impl BB.Sensor
  def terminate(_reason, %{port: nil}), do: :ok

  def terminate(_reason, %{port: port, grace_ms: grace_ms}) do
    # Any byte asks the guard to stop the program; its exit status says that nothing is left.
    if open?(port) and Port.command(port, "\n") do
      receive do
        {^port, {:exit_status, _}} -> :ok
      after
        grace_ms + @kill_limit_ms -> Port.close(port)
      end
    end

    :ok
  end

  defp start(program, opts) do
    guard_args = [
      "--grace-ms",
      to_string(opts[:grace_ms]),
      "--nice",
      to_string(opts[:nice]),
      "--",
      program
    ]

    Port.open({:spawn_executable, shipped(@guard)}, [
      :binary,
      :exit_status,
      :stderr_to_stdout,
      :hide,
      line: @longest_line,
      args: guard_args ++ topic_args(opts[:topics]) ++ args(opts[:args]),
      env:
        for({key, value} <- opts[:env], do: {String.to_charlist(key), String.to_charlist(value)})
    ])
  end

  defp topic_args(topics),
    do: Enum.flat_map(topics, fn {key, topic} -> ["--" <> dashed(key), topic] end)

  defp dashed(key), do: key |> to_string() |> String.replace("_", "-")

  defp args({module, function, arguments}), do: apply(module, function, arguments)
  defp args(args), do: args

  defp open?(port), do: Port.info(port) != nil

  defp find_program(name) do
    case Enum.find([shipped(name), System.find_executable(name)], &(&1 && File.regular?(&1))) do
      nil -> :error
      program -> {:ok, program}
    end
  end

  defp shipped(name), do: Application.app_dir(:ganglion, ["priv", "bin", name])
end

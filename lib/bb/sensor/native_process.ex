defmodule BB.Sensor.NativeProcess do
  @moduledoc """
  An operating-system process in the sensor tree: a camera, a detector, or any other program that
  works through the ring.

  Declare one for each native program of a robot:

      sensor :tags,
             {BB.Sensor.NativeProcess,
              program: "vision_tags",
              topics: [frames: "camera", detections: "tags"],
              publishes: [:detections]},
             max_silence: ~u(1 second)

  The process starts with its sensor and is restarted like any sensor, by backoff. Its data goes
  through ring topics; `BB.Handoff.Inlet` carries a topic onto the pubsub.

  ## No orphan

  No process is left, however the BEAM ends. The program runs under `process_guard`, which ends
  it, and everything that it started, when its sensor stops or when the pipe to the BEAM closes,
  even if SIGKILL ended the BEAM. The sensor stops only after all its processes have exited. When
  `process_guard` itself is killed, all its processes are ended too, and the sensor goes down.

  ## Output

  Standard output and standard error of the program are logged line by line under the sensor's
  name. A `\\r` ends a line too, and a line of more than 4 KiB is cut. When a program exceeds
  `log_rate` for long, lines are left out and the log says how many; its last 128 lines are always
  logged. No output makes the program wait or the BEAM's memory grow.

  ## Hanging programs

  A program that has stopped working is ended and restarted:

    * after `halt_ms`, when a signal has halted it
    * after its `max_silence` and `hang_ms` more, when it has published nothing on its topics; the
      sensor is `:stale` in between. A sensor without `max_silence` has no such limit.

  ## Reasons

  The sensor stops with one of these reasons, which its `BB.Message.Sensor.Status` carries:

    * `{:program_not_found, name}`, `{:not_executable, path}`, `{:unknown_application, app}`,
      `{:no_program, text}` - `program:` names no program that can be run
    * `{:topic, text}` - a name in `topics` or `publishes` is not valid under the robot's topic
      prefix
    * `{:not_started, reason}` - the operating system refused to start the program
    * `{:no_topic, key}` - `publishes` names a key that `topics` does not have
    * `{:exit_status, n}` - the program exited; n is 128 plus the signal's number when a signal
      ended it, and 127 when it could not be run
    * `{:halted, ms}`, `{:hung, ms}` - the program had stopped working, and was ended

  ## Options

  #{BB.Options.docs(BB.Sensor.NativeProcess.Options.schema())}
  """

  use BB.Sensor, options_schema: BB.Sensor.NativeProcess.Options.schema()

  require Logger

  alias BB.Sensor.NativeProcess.{Guard, Program, TopicActivity, Topics}

  # The kernel's time to end killed processes, and then to wake and end halted ones.
  @kill_limit_ms 3_000
  @wake_limit_ms 2_000
  @margin_ms 1_000

  # The checks of the topics in one max_silence, and the bounds of their period.
  @checks_per_silence 4
  @check_ms 5..1_000

  @doc """
  Formats a reason of the sensor.

      iex> BB.Sensor.NativeProcess.explain({:exit_status, 137})
      "the program was ended by signal 9"
      iex> BB.Sensor.NativeProcess.explain({:exit_status, 1})
      "the program exited with status 1; the log has its output"
  """
  @impl BB.Sensor
  @spec explain(reason :: term()) :: String.t()
  def explain({:exit_status, 127}), do: "the program cannot be run; the log says why"

  def explain({:exit_status, status}) when status > 128,
    do: "the program was ended by signal #{status - 128}"

  def explain({:exit_status, status}),
    do: "the program exited with status #{status}; the log has its output"

  def explain({:halted, ms}),
    do: "the program was halted by a signal (SIGSTOP) for #{ms} ms, and was killed"

  def explain({:hung, ms}), do: "the program published nothing for #{ms} ms, and was ended"

  def explain({:no_topic, key}),
    do: "publishes: #{inspect(key)} is no ring topic; add it to `topics:`, or correct it"

  def explain({:not_started, reason}), do: "the program cannot be started: #{inspect(reason)}"
  def explain({:topic, message}), do: message
  def explain(reason), do: Program.explain(reason)

  @doc false
  @impl BB.Sensor
  def max_silence(opts), do: Topics.check_max_silence(opts)

  @doc false
  @impl BB.Sensor
  def topics(opts), do: Topics.names(opts)

  @impl BB.Sensor
  def init(opts) do
    with {:ok, opts} <- Topics.resolve(opts, opts[:bb].robot),
         {:ok, program} <- Program.find(opts[:program]),
         {:ok, topics, publishes} <- Topics.published(opts) do
      limit_ms = opts[:grace_ms] + @kill_limit_ms + @wake_limit_ms + @margin_ms
      :ok = BB.Sensor.shut_down_within(limit_ms)

      state = %{
        port: nil,
        arguments: Guard.arguments(opts, command(program, opts)),
        env: opts[:env],
        name: List.last(opts[:bb].path),
        level: opts[:log_level],
        log_rate: opts[:log_rate],
        grace_ms: opts[:grace_ms],
        halt_ms: opts[:halt_ms],
        hang_ms: opts[:hang_ms],
        activity: TopicActivity.new(topics, publishes),
        active_ms: nil,
        halted?: false,
        unacknowledged: 0
      }

      {:ok, state, {:continue, :start}}
    else
      {:error, reason} -> {:stop, reason}
    end
  end

  defp command(program, opts), do: [program | topic_args(opts[:topics]) ++ args(opts[:args])]

  defp topic_args(topics),
    do: Enum.flat_map(topics, fn {key, topic} -> ["--" <> dashed(key), topic] end)

  defp dashed(key), do: key |> to_string() |> String.replace("_", "-")

  defp args({module, function, arguments}), do: apply(module, function, arguments)
  defp args(args), do: args

  # The keeper waits for the end of this process only once init/1 has returned.
  @impl BB.Sensor
  def handle_continue(:start, state) do
    schedule_check(state)
    {:noreply, %{state | port: Guard.open(state.arguments, state.env), active_ms: now_ms()}}
  rescue
    error in ErlangError -> {:stop, {:shutdown, {:not_started, error.original}}, state}
  end

  @impl BB.Sensor
  def handle_info({port, {:data, data}}, %{port: port} = state),
    do: {:noreply, handle_frame(Guard.parse(data), state)}

  def handle_info({port, {:exit_status, status}}, %{port: port} = state) do
    reason = if state.halted?, do: {:halted, state.halt_ms}, else: {:exit_status, status}
    {:stop, {:shutdown, reason}, %{state | port: nil}}
  end

  def handle_info(:check, state), do: check_activity(state)
  def handle_info(_other, state), do: {:noreply, state}

  @impl BB.Sensor
  def terminate(_reason, %{port: nil}), do: :ok

  # The port's exit status says that all processes have exited.
  def terminate(_reason, %{port: port} = state) do
    with true <- Guard.stop(port),
         {:late, state} <- await_exit(state, now_ms() + state.grace_ms + @kill_limit_ms),
         :ok <- Guard.wake(port),
         {:late, state} <- await_exit(state, now_ms() + @wake_limit_ms),
         do: Logger.error("#{state.name}: #{format_late(state.grace_ms)}")

    Guard.close(port)
  end

  defp format_late(grace_ms) do
    "the program has not exited within #{grace_ms + @kill_limit_ms + @wake_limit_ms} ms; " <>
      "it may hang in a driver of the kernel"
  end

  defp await_exit(%{port: port} = state, until_ms) do
    receive do
      {^port, {:exit_status, _}} ->
        :exited

      {^port, {:data, data}} ->
        data |> Guard.parse() |> handle_frame(state) |> await_exit(until_ms)
    after
      max(until_ms - now_ms(), 0) -> {:late, state}
    end
  end

  # Frames of the guard

  defp handle_frame({:line, line}, state) do
    Logger.log(state.level, fn -> [to_string(state.name), ": ", line] end)
    acknowledge(state)
  end

  defp handle_frame({:left_out, count}, state) do
    Logger.warning(
      "#{state.name}: #{count} lines were left out: the program printed over " <>
        "#{state.log_rate} a second"
    )

    acknowledge(state)
  end

  defp handle_frame(:halted, state), do: %{state | halted?: true}

  defp handle_frame(:end_of_output, state) do
    _ = Guard.confirm_end(state.port)
    state
  end

  defp acknowledge(state),
    do: %{state | unacknowledged: Guard.acknowledge(state.port, state.unacknowledged + 1)}

  # Activity on the ring topics

  defp check_activity(%{port: nil} = state), do: {:noreply, state}

  defp check_activity(state) do
    {result, activity} = TopicActivity.check(state.activity, Guard.os_pid(state.port))
    now_ms = now_ms()
    state = put_result(result, %{state | activity: activity}, now_ms)

    case hung_ms(state, now_ms) do
      nil ->
        schedule_check(state)
        {:noreply, state}

      hung_ms ->
        {:stop, {:shutdown, {:hung, hung_ms}}, state}
    end
  end

  defp put_result({:program, false}, state, _now_ms), do: state

  # When other processes publish on all topics, their silence does not end the program.
  defp put_result({_publisher, published?}, state, now_ms) do
    _ = if published?, do: BB.Sensor.beat()
    %{state | active_ms: now_ms}
  end

  defp hung_ms(%{hang_ms: :infinity}, _now_ms), do: nil

  defp hung_ms(state, now_ms) do
    limit_ms = max_silence_ms() + state.hang_ms
    if now_ms - state.active_ms >= limit_ms, do: limit_ms
  end

  defp schedule_check(%{activity: %{topics: []}}), do: :ok

  defp schedule_check(_state) do
    _ =
      if BB.Sensor.max_silence_ns() do
        period_ms = div(max_silence_ms(), @checks_per_silence)
        period_ms = period_ms |> max(@check_ms.first) |> min(@check_ms.last)
        Process.send_after(self(), :check, period_ms)
      end

    :ok
  end

  defp max_silence_ms, do: div(BB.Sensor.max_silence_ns(), 1_000_000)
  defp now_ms, do: System.monotonic_time(:millisecond)
end

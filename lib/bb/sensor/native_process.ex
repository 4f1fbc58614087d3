defmodule BB.Sensor.NativeProcess do
  @schema BB.Options.new!(
            program: [
              type: {:custom, BB.Sensor.NativeProcess.Program, :check, []},
              required: true,
              type_doc: "`t:BB.Sensor.NativeProcess.Program.t/0`",
              doc: """
              `{:my_app, "name"}`, a program in the `priv/bin` of that application; one of those \
              that ship with Ganglion, a path, or a name to be found in `PATH`; or a function \
              that gives one of these at each start: `&MyRobot.detector/0` or \
              `{module, function, arguments}`.
              """
            ],
            topics: [
              type: :keyword_list,
              default: [],
              doc:
                "The ring topics that it works with, given to it as options: `frames: \"camera\"` becomes `--frames camera`, with the robot's prefix before `camera` (`BB.Topic`)."
            ],
            publishes: [
              type: {:list, {:or, [:atom, :string]}},
              doc: """
              The ring topics that it publishes, for `max_silence`: keys of `topics`, or names. \
              Without it those of `topics` count whose writer it is, or all where each has another.
              """
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
              doc: "Milliseconds from SIGTERM to SIGKILL when it is stopped; its sensor waits."
            ],
            halt_ms: [
              type: {:or, [{:in, 0..3_600_000}, {:literal, :infinity}]},
              default: 1_000,
              doc: "Milliseconds for which SIGSTOP may halt it before it is started again."
            ],
            hang_ms: [
              type: {:or, [{:in, 0..3_600_000}, {:literal, :infinity}]},
              default: 10_000,
              doc: """
              Milliseconds for which it may publish nothing beyond its `max_silence` before it \
              is ended and started again. More than it takes to start.
              """
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
            ],
            log_rate: [
              type: {:in, 1..1_000},
              default: 100,
              doc: "Lines a second that it may print; ten times as many at once."
            ]
          )

  @moduledoc """
  An operating-system process in the sensor tree: a camera, a detector, anything that speaks through the ring.

      sensor :tags, {BB.Sensor.NativeProcess, program: "vision_tags", topics: [frames: "camera", detections: "tags"]}

  It starts with its sensor and is restarted as any sensor is, by backoff. What it measures goes
  through ring topics; `BB.Handoff.Inlet` brings a topic onto the pubsub.

  **No orphan is left**, however the BEAM ends: the process runs under `process_guard`, which ends
  it, and everything that it started, as soon as its sensor stops, or the pipe to the BEAM closes,
  as it does when the BEAM is killed by `SIGKILL`. The end of the sensor waits until nothing is
  left. If `process_guard` is killed itself, all is ended too, and the sensor goes down.

  **What it prints**, on standard output or error, is logged line by line under the sensor's name.
  `\\r` ends a line too, and a line of more than 4 KiB is cut. A program that prints more than
  `log_rate` for long finds the rest left out, and the log says how many lines; its last 128 lines
  are never among them. No output makes the program wait or the BEAM's memory grow.

  **One that does not go on** is ended and started again: when a signal has halted it for
  `halt_ms`, and, where its robot declares a `max_silence`, when it has published nothing on its
  topics for that long (it is `:stale` then) and `hang_ms` more.

      sensor :tags,
             {BB.Sensor.NativeProcess,
              program: "vision_tags",
              topics: [frames: "camera", detections: "tags"],
              publishes: [:detections]},
             max_silence: ~u(1 second)

  The sensor stops with one of these reasons, which its `BB.Message.Sensor.Status` shows:

    * `{:program_not_found, name}`, `{:not_executable, path}`, `{:unknown_application, app}`,
      `{:no_program, text}` - there is nothing to run, as `program:` has it
    * `{:topic, text}` - a name of `topics` or `publishes` is none under the robot's prefix
    * `{:not_started, reason}`
    * `{:no_topic, key}` - `publishes` names what is not among `topics`
    * `{:exit_status, n}` - 128 + the signal's number when a signal ended it; 127 when it could
      not be run
    * `{:halted, ms}`, `{:hung, ms}` - it did not go on, and was ended

  ## Options

  #{BB.Options.docs(@schema)}
  """

  use BB.Sensor, options_schema: @schema

  require Logger

  alias BB.Sensor.NativeProcess.{Feed, Program}

  @guard "process_guard"

  # Beyond the grace, the guard needs as long as the kernel takes to end what it kills. One that
  # was halted needs to be woken.
  @kill_limit_ms 3_000
  @wake_limit_ms 2_000
  @margin_ms 1_000

  # Lines that the guard may send ahead; half of them are acknowledged together.
  @window 64

  # How often the topics are looked at: so often in a max_silence, within these bounds.
  @looks 4
  @looks_ms 5..1_000

  @doc """
  A reason in words.

      iex> BB.Sensor.NativeProcess.explain({:exit_status, 137})
      "its program was ended by signal 9"
      iex> BB.Sensor.NativeProcess.explain({:exit_status, 1})
      "its program ended with status 1; what it said is in the log"
  """
  @impl BB.Sensor
  def explain({:exit_status, 127}), do: "its program cannot be run; the log says why"

  def explain({:exit_status, status}) when status > 128,
    do: "its program was ended by signal #{status - 128}"

  def explain({:exit_status, status}),
    do: "its program ended with status #{status}; what it said is in the log"

  def explain({:halted, ms}),
    do: "its program was halted by a signal (SIGSTOP) for #{ms} ms, and was killed"

  def explain({:hung, ms}), do: "its program published nothing for #{ms} ms, and was ended"

  def explain({:no_topic, key}),
    do: "publishes: #{inspect(key)} is no ring topic; add it to its topics, or correct it"

  def explain({:not_started, reason}), do: "its program cannot be started: #{inspect(reason)}"
  def explain({:topic, why}), do: why
  def explain(reason), do: Program.explain(reason)

  @doc false
  @impl BB.Sensor
  def max_silence(opts) do
    topics = Keyword.get(opts, :topics, [])
    publishes = opts[:publishes]

    cond do
      # A parameter, or a mistake that the robot's start tells.
      not (Keyword.keyword?(topics) and (is_nil(publishes) or is_list(publishes))) -> :ok
      publishes == [] or (publishes == nil and topics == []) -> {:error, unmeasured()}
      key = Enum.find(publishes || [], &unknown?(&1, topics)) -> {:error, unknown(key, topics)}
      true -> :ok
    end
  end

  defp unmeasured do
    """
    it has a max_silence, and no ring topic by which that could be measured; name the topics \
    that its program publishes in `topics:` or `publishes:`, or remove max_silence\
    """
  end

  defp unknown(key, topics) do
    """
    publishes: expected keys of its topics or names of ring topics, got: #{inspect(key)}; its \
    topics have #{inspect(Keyword.keys(topics))}; correct it, or add the topic\
    """
  end

  defp unknown?(key, topics), do: is_atom(key) and not Keyword.has_key?(topics, key)

  @impl BB.Sensor
  def init(opts) do
    with {:ok, opts} <- resolve(opts),
         {:ok, program} <- Program.find(opts[:program]),
         {:ok, feed} <- feed(opts) do
      limit_ms = opts[:grace_ms] + @kill_limit_ms + @wake_limit_ms + @margin_ms
      :ok = BB.Sensor.shut_down_within(limit_ms)

      state = %{
        port: nil,
        command: guard_args(opts) ++ [program | topic_args(opts[:topics]) ++ args(opts[:args])],
        env: opts[:env],
        name: List.last(opts[:bb].path),
        level: opts[:log_level],
        log_rate: opts[:log_rate],
        grace_ms: opts[:grace_ms],
        halt_ms: opts[:halt_ms],
        hang_ms: opts[:hang_ms],
        feed: feed,
        fed_ms: nil,
        halted?: false,
        taken: 0
      }

      {:ok, state, {:continue, :start}}
    else
      {:error, reason} -> {:stop, reason}
    end
  end

  defp resolve(opts) do
    robot = opts[:bb].robot

    with {:ok, topics} <- resolve_all(opts[:topics], robot),
         {:ok, publishes} <- resolve_all(opts[:publishes] || [], robot) do
      {:ok, Keyword.merge(opts, topics: topics, publishes: if(opts[:publishes], do: publishes))}
    end
  end

  # Those of `publishes` may be keys of `topics`.
  defp resolve_all(names, robot) do
    Enum.reduce_while(names, {:ok, []}, fn name, {:ok, resolved} ->
      case resolve_one(name, robot) do
        {:ok, topic} -> {:cont, {:ok, resolved ++ [topic]}}
        {:error, why} -> {:halt, {:error, {:topic, why}}}
      end
    end)
  end

  defp resolve_one({key, name}, robot) do
    with {:ok, topic} <- resolve_one(name, robot), do: {:ok, {key, topic}}
  end

  defp resolve_one(name, robot) when is_binary(name), do: BB.Topic.of(robot, name)
  defp resolve_one(key, _robot), do: {:ok, key}

  @doc false
  @impl BB.Sensor
  def topics(opts) do
    for names <- [opts[:topics], opts[:publishes]], is_list(names), entry <- names do
      with {_key, name} <- entry, do: name
    end
    |> Enum.filter(&is_binary/1)
  end

  # Only now does the keeper wait for its end.
  @impl BB.Sensor
  def handle_continue(:start, state) do
    look_later(state)
    {:noreply, %{state | port: open(state), fed_ms: now_ms()}}
  rescue
    error in ErlangError -> {:stop, {:shutdown, {:not_started, error.original}}, state}
  end

  @impl BB.Sensor
  def handle_info({port, {:data, said}}, %{port: port} = state), do: {:noreply, hear(said, state)}

  def handle_info({port, {:exit_status, status}}, %{port: port} = state) do
    reason = if state.halted?, do: {:halted, state.halt_ms}, else: {:exit_status, status}
    {:stop, {:shutdown, reason}, %{state | port: nil}}
  end

  def handle_info(:look, state), do: look(state)
  def handle_info(_other, state), do: {:noreply, state}

  @impl BB.Sensor
  def terminate(_reason, %{port: nil}), do: :ok

  # The guard's exit status says that nothing is left.
  def terminate(_reason, %{port: port} = state) do
    with true <- tell(port, "s"),
         {:late, state} <- await_end(state, now_ms() + state.grace_ms + @kill_limit_ms),
         :ok <- wake(port),
         {:late, state} <- await_end(state, now_ms() + @wake_limit_ms),
         do: Logger.error("#{state.name}: its program does not end")

    close(port)
  end

  defp await_end(%{port: port} = state, until_ms) do
    receive do
      {^port, {:exit_status, _}} -> :ended
      {^port, {:data, said}} -> said |> hear(state) |> await_end(until_ms)
    after
      max(until_ms - now_ms(), 0) -> {:late, state}
    end
  end

  # A watch that was halted goes on, and ends a guard that is halted too.
  defp wake(port) do
    _ = System.cmd("kill", ["-s", "CONT", to_string(os_pid(port))], stderr_to_stdout: true)
    :ok
  rescue
    error in ErlangError -> {:error, error.original}
  end

  # What the guard says: native/process_guard/src/output.rs.

  defp hear(<<"l", line::binary>>, state) do
    Logger.log(state.level, fn -> [to_string(state.name), ": ", line] end)
    take(state)
  end

  defp hear(<<"o", count::binary>>, state) do
    Logger.warning(
      "#{state.name}: #{count} lines were left out: it prints over #{state.log_rate} a second"
    )

    take(state)
  end

  defp hear("h", state), do: %{state | halted?: true}

  # From here on the guard may end at any time, and a word to it would break the pipe.
  defp hear("e", state) do
    _ = tell(state.port, "e")
    state
  end

  defp take(%{taken: taken} = state) when taken + 1 < div(@window, 2),
    do: %{state | taken: taken + 1}

  defp take(%{taken: taken} = state) do
    told? = tell(state.port, <<"c", taken + 1::16>>)
    %{state | taken: if(told?, do: 0, else: taken + 1)}
  end

  defp tell(port, request) do
    Port.command(port, request, [:nosuspend])
  rescue
    # The guard has ended.
    ArgumentError -> false
  end

  defp close(port) do
    Port.close(port)
    :ok
  rescue
    ArgumentError -> :ok
  end

  # Whether it goes on.

  defp look(%{port: nil} = state), do: {:noreply, state}

  defp look(state) do
    {shown, feed} = Feed.look(state.feed, os_pid(state.port))
    now_ms = now_ms()
    state = fed(shown, %{state | feed: feed}, now_ms)

    case hung_ms(state, now_ms) do
      nil ->
        look_later(state)
        {:noreply, state}

      hung_ms ->
        {:stop, {:shutdown, {:hung, hung_ms}}, state}
    end
  end

  defp fed({:program, false}, state, _now_ms), do: state

  # The silence of others is no reason to end it.
  defp fed({_writer, fed?}, state, now_ms) do
    _ = if fed?, do: BB.Sensor.beat()
    %{state | fed_ms: now_ms}
  end

  defp hung_ms(%{hang_ms: :infinity}, _now_ms), do: nil

  defp hung_ms(state, now_ms) do
    limit_ms = max_silence_ms() + state.hang_ms
    if now_ms - state.fed_ms >= limit_ms, do: limit_ms
  end

  defp look_later(%{feed: %{topics: []}}), do: :ok

  defp look_later(_state) do
    _ =
      if BB.Sensor.max_silence_ns() do
        often_ms = div(max_silence_ms(), @looks)
        Process.send_after(self(), :look, often_ms |> max(@looks_ms.first) |> min(@looks_ms.last))
      end

    :ok
  end

  defp max_silence_ms, do: div(BB.Sensor.max_silence_ns(), 1_000_000)

  defp os_pid(port) do
    case Port.info(port, :os_pid) do
      {:os_pid, os_pid} -> os_pid
      nil -> 0
    end
  end

  defp feed(opts) do
    topics = opts[:topics]

    case opts[:publishes] do
      nil ->
        {:ok, Feed.new(Enum.filter(Keyword.values(topics), &topic?/1), :by_writer)}

      keys ->
        names = for key <- keys, do: {key, if(is_atom(key), do: topics[key], else: key)}

        case Enum.find(names, fn {_key, name} -> not topic?(name) end) do
          nil -> {:ok, Feed.new(Enum.map(names, &elem(&1, 1)), :all)}
          {key, _name} -> {:error, {:no_topic, key}}
        end
    end
  end

  # What the program takes may be called a topic and be none.
  defp topic?(name), do: match?({:ok, _name}, BB.Ring.check_found_topic(name))

  # The guard

  defp open(state) do
    Port.open({:spawn_executable, Program.shipped(@guard)}, [
      :binary,
      :exit_status,
      :hide,
      packet: 2,
      arg0: "process_watch",
      args: state.command,
      env: for({key, value} <- state.env, do: {to_charlist(key), to_charlist(value)})
    ])
  end

  defp guard_args(opts) do
    halt = if opts[:halt_ms] == :infinity, do: [], else: ["--halt-ms", opts[:halt_ms]]

    ["--grace-ms", opts[:grace_ms], "--nice", opts[:nice]]
    |> Kernel.++(["--lines-per-second", opts[:log_rate], "--frames", @window])
    |> Kernel.++(halt ++ ["--"])
    |> Enum.map(&to_string/1)
  end

  defp topic_args(topics),
    do: Enum.flat_map(topics, fn {key, topic} -> ["--" <> dashed(key), topic] end)

  defp dashed(key), do: key |> to_string() |> String.replace("_", "-")

  defp args({module, function, arguments}), do: apply(module, function, arguments)
  defp args(args), do: args

  defp now_ms, do: System.monotonic_time(:millisecond)
end

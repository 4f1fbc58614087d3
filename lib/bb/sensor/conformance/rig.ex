defmodule BB.Sensor.Conformance.Rig do
  @moduledoc """
  The test rig of a conformance test: a running robot whose only sensor is the driver under test,
  on simulated wires of its own.

  `BB.Sensor.Conformance.Checks` acts on the rig, by faults, new options and stepped time, and
  reads what the driver does: its health, statuses, messages and alarms.
  """
  @moduledoc no_example: "internal: `use BB.Sensor.Conformance` runs the checks"

  alias BB.Clock.Stepped
  alias BB.Sensor.Conformance.{Robot, Setting}

  @enforce_keys [:robot, :place, :setting, :stepped?, :events]
  defstruct @enforce_keys

  @type t :: %__MODULE__{
          robot: module(),
          place: map(),
          setting: Setting.t(),
          stepped?: boolean(),
          events: :counters.counters_ref()
        }

  @poll_ms 2
  @event_ns 500_000_000

  @doc """
  Runs `fun` with a rig, and stops the rig afterwards.

    * `:stepped?` - whether the time of the robot and of the chip passes by `pass/2` alone
    * `:device` - the device that is plugged in at first; by default the driver's own
    * `:broken` - a fault that is present before the robot starts
  """
  @spec run(
          Setting.t(),
          [stepped?: boolean(), device: Setting.device(), broken: atom()],
          (t() -> result)
        ) :: result
        when result: term()
  def run(setting, opts \\ [], fun) do
    unique = System.unique_integer([:positive])
    robot = Module.concat(setting.driver, "Conformance#{unique}")
    stepped? = Keyword.get(opts, :stepped?, false)
    clock = if stepped?, do: start_clock(robot)
    plugged = %{setting | device: opts[:device] || setting.device}
    {wires, place} = setting.wires.start(plugged, "conformance-#{unique}", BB.Clock.of(robot))
    _ = if opts[:broken], do: setting.wires.break(place, opts[:broken])
    :ok = Robot.create(robot, setting, place)
    {:ok, root} = robot.start_link()
    _ = subscribe(robot)

    try do
      fun.(%__MODULE__{
        robot: robot,
        place: place,
        setting: setting,
        stepped?: stepped?,
        events: :counters.new(1, [])
      })
    after
      for pid <- [root, wires, clock], is_pid(pid), do: stop(pid)
      flush(robot)
    end
  end

  defp start_clock(robot) do
    {:ok, clock} = Stepped.start_link(robot: robot)
    # The process that lets time pass must not fall behind the driver's own waits.
    _ = Process.flag(:priority, :high)
    clock
  end

  defp subscribe(robot) do
    {:ok, _} = BB.subscribe(robot, [:sensor_status], replay: true)
    {:ok, _} = BB.subscribe(robot, [:sensor])
  end

  @doc "Stops a process in order. A process that has exited is stopped already."
  @spec stop(pid()) :: :ok
  def stop(pid) do
    GenServer.stop(pid)
  catch
    :exit, _gone -> :ok
  end

  defp flush(robot) do
    receive do
      {:bb, _path, %{robot: ^robot}} -> flush(robot)
    after
      0 -> :ok
    end
  end

  # Acting on the rig

  @doc """
  Begins a fault while no callback of the driver runs, and drops the messages published before.

  Returns the nanoseconds between the newest of those messages and the fault. A driver that waits
  for an edge may have the edge of such a time in its mailbox: a message measured then is a new
  reading from before the fault.
  """
  @spec break(t(), atom(), BB.Message.t()) :: Range.t()
  def break(rig, fault, last_message) do
    pid = pid!(rig)
    :ok = :sys.suspend(pid)
    :ok = rig.setting.wires.break(rig.place, fault)
    broken_ns = System.monotonic_time(:nanosecond)
    times = for message <- [last_message | messages(rig)], do: message.monotonic_time
    flush(rig.robot)
    :sys.resume(pid)
    (Enum.max(times) + 1)..broken_ns//1
  end

  @doc "Ends a fault, and returns the time at which it ended."
  @spec repair(t(), atom()) :: integer()
  def repair(rig, fault) do
    now_ns = System.monotonic_time(:nanosecond)
    :ok = rig.setting.wires.mend(rig.place, fault)
    now_ns
  end

  @doc "Changes the driver's options, and waits until the driver has applied them."
  @spec change_options(t(), keyword()) :: :ok
  def change_options(rig, options) do
    pid = pid!(rig)
    :ok = BB.Parameter.set_many(rig.robot, for({key, value} <- options, do: {[key], value}))

    # Once the driver has begun to apply them, no tick of its loop is due before it has finished.
    # It may use the chip's time for that.
    await(rig, "applies new options", fn -> idle?(pid) end, pass?: false)
    task = Task.async(fn -> await_reply(pid, rig.setting.patience_ms) end)
    await(rig, "applies new options", fn -> Task.yield(task, 0) end)
    :ok
  end

  # Its row shows a driver that the new options have stopped.
  defp await_reply(pid, timeout_ms) do
    :sys.statistics(pid, :get, timeout_ms)
  catch
    :exit, {reason, _call} when reason != :timeout -> :exited
  end

  defp idle?(pid), do: Process.info(pid, :message_queue_len) in [nil, {:message_queue_len, 0}]

  @doc "Lets stepped time pass, and waits until the driver has handled its messages."
  @spec pass(t(), non_neg_integer()) :: :ok
  def pass(rig, duration_ns),
    do: Stepped.advance(rig.robot, duration_ns, settle: List.wrap(row(rig).pid))

  # Reading what the driver does

  @doc "Returns the driver's row of health."
  @spec row(t()) :: map()
  def row(rig), do: hd(BB.Sensor.health(rig.robot))

  @doc "Returns the driver's process, or fails the check."
  @spec pid!(t()) :: pid()
  def pid!(rig), do: row(rig).pid || fail!("the driver is not up: #{inspect(row(rig))}")

  @doc """
  Fails the check.

  It throws to `BB.Sensor.Conformance.run/2`, which raises the failure.
  """
  @spec fail!(String.t()) :: no_return()
  def fail!(sentence), do: throw({__MODULE__, :failed, sentence})

  @doc "Returns how many messages the driver has published."
  @spec published(t()) :: non_neg_integer()
  def published(rig) do
    Enum.sum(for %{path: [:sensor | _], count: count} <- BB.PubSub.topics(rig.robot), do: count)
  end

  @doc "Returns the statuses that were published since the last call."
  @spec statuses(t()) :: [BB.Message.Sensor.Status.t()]
  def statuses(%{robot: robot} = rig) do
    receive do
      {:bb, [:sensor_status | _], %{robot: ^robot, payload: status}} -> [status | statuses(rig)]
    after
      0 -> []
    end
  end

  @doc """
  Waits for at least one status, and returns all since the last call.

  A status is published a moment after the row shows the state.
  """
  @spec await_statuses(t(), String.t()) :: [BB.Message.Sensor.Status.t(), ...]
  def await_statuses(rig, expectation) do
    await(rig, expectation, fn -> with [] <- statuses(rig), do: nil end)
  end

  @doc "Returns the messages that the driver has published since the last call."
  @spec messages(t()) :: [BB.Message.t()]
  def messages(%{robot: robot} = rig) do
    receive do
      {:bb, [:sensor | _], %{robot: ^robot} = message} -> [message | messages(rig)]
    after
      0 -> []
    end
  end

  @doc "Returns the descriptions of the driver's alarms."
  @spec alarms(t()) :: [term()]
  def alarms(%{robot: robot}),
    do:
      for(
        {{BB.Sensor, ^robot, _path}, description} <- :alarm_handler.get_alarms(),
        do: description
      )

  @doc "Waits until the driver has `count` alarms, and returns them."
  @spec await_alarms(t(), String.t(), non_neg_integer()) :: [term()]
  def await_alarms(rig, expectation, count) do
    _ = await(rig, expectation, fn -> length(alarms(rig)) == count end)
    alarms(rig)
  end

  @doc "Waits until the driver is up, and returns its row."
  @spec await_up(t()) :: map()
  def await_up(rig), do: await(rig, "is up", &(&1.state == :up))

  @doc "Waits until the driver is not up, and returns its row."
  @spec await_down(t(), String.t()) :: map()
  def await_down(rig, why), do: await(rig, why, &(&1.state not in [:up, :starting]))

  @doc """
  Waits for a message.

  For a driver that publishes events it triggers events until a message comes.
  """
  @spec await_message(t()) :: BB.Message.t()
  def await_message(%{setting: %{event: nil}} = rig), do: await_message(rig, fn -> nil end)

  def await_message(rig) do
    last = :counters.new(1, [])

    await_message(rig, fn ->
      now_ns = System.monotonic_time(:nanosecond)

      if :counters.get(last, 1) == 0 or now_ns - :counters.get(last, 1) > @event_ns do
        :counters.put(last, 1, now_ns)
        trigger_event(rig)
      end
    end)
  end

  defp await_message(rig, trigger) do
    await(rig, "publishes", fn ->
      trigger.()
      List.first(messages(rig))
    end)
  end

  @doc "Triggers the next event."
  @spec trigger_event(t()) :: term()
  def trigger_event(rig) do
    :counters.add(rig.events, 1, 1)
    rig.setting.event.(rig.place, :counters.get(rig.events, 1))
  end

  @doc """
  Waits until `fun` returns a true value, and returns that value, or the driver's row for `true`.

  `fun` takes the row, or nothing. Unless `pass?: false` is given, stepped time passes meanwhile
  as fast as the machine's. `expectation` continues the sentence "expected that the driver …" of a
  failure.
  """
  @spec await(t(), String.t(), (map() -> term()) | (() -> term()), pass?: boolean()) :: term()
  def await(rig, expectation, fun, opts \\ []) do
    now_ns = System.monotonic_time(:nanosecond)
    pass? = rig.stepped? and Keyword.get(opts, :pass?, true)
    until_ns = now_ns + rig.setting.patience_ms * 1_000_000
    await(rig, expectation, fun, pass?, until_ns, now_ns)
  end

  defp await(rig, expectation, fun, pass?, until_ns, last_ns) do
    row = row(rig)
    result = if is_function(fun, 1), do: fun.(row), else: fun.()
    now_ns = System.monotonic_time(:nanosecond)

    cond do
      result == true ->
        row

      result ->
        result

      now_ns > until_ns ->
        fail!(
          "expected that the driver #{expectation}, within #{rig.setting.patience_ms} ms; " <>
            "it is #{format_state(row)}"
        )

      true ->
        Process.sleep(@poll_ms)
        # The driver may be waiting for its chip, and so is not waited for.
        if pass?, do: Stepped.advance(rig.robot, now_ns - last_ns)
        await(rig, expectation, fun, pass?, until_ns, now_ns)
    end
  end

  defp format_state(%{state: state, error: nil}), do: to_string(state)
  defp format_state(%{state: state, error: error}), do: "#{state}, last error: #{error}"
end

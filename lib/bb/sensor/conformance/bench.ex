defmodule BB.Sensor.Conformance.Bench do
  @moduledoc """
  A robot whose only sensor is the driver under test, on wires of its own, and what can be seen of it.
  """

  alias BB.Clock.Stepped
  alias BB.Sensor.Conformance.{Failure, Setting}

  @enforce_keys [:robot, :place, :setting, :stepped?, :events]
  defstruct @enforce_keys

  @type t :: %__MODULE__{
          robot: module(),
          place: map(),
          setting: Setting.t(),
          stepped?: boolean(),
          events: :counters.counters_ref()
        }

  @subject :subject
  @look_ms 2
  @event_ns 500_000_000

  @doc """
  Runs `fun` with a bench, and takes that down afterwards. With `stepped?: true` the robot's time and the chip's go by `pass/2`.

  `device:` is what is plugged in at first, the driver's own when not given; `broken:` a fault that there is before the robot starts.
  """
  @spec on(
          Setting.t(),
          [stepped?: boolean(), device: Setting.device(), broken: atom()],
          (t() -> result)
        ) :: result
        when result: term()
  def on(setting, opts \\ [], fun) do
    unique = System.unique_integer([:positive])
    robot = Module.concat(setting.driver, "Conformance#{unique}")
    stepped? = Keyword.get(opts, :stepped?, false)
    clock = if stepped?, do: start_clock(robot)
    plugged = %{setting | device: opts[:device] || setting.device}
    {wires, place} = setting.wires.start(plugged, "conformance-#{unique}", BB.Clock.of(robot))
    _ = if opts[:broken], do: setting.wires.break(place, opts[:broken])
    declare(robot, setting, place)
    {:ok, root} = robot.start_link()
    _ = watch(robot)

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
      forget(robot)
    end
  end

  defp start_clock(robot) do
    {:ok, clock} = Stepped.start_link(robot: robot)
    # Whoever lets time pass is not to fall behind the driver's own waits.
    _ = Process.flag(:priority, :high)
    clock
  end

  defp watch(robot) do
    {:ok, _} = BB.subscribe(robot, [:sensor_status], replay: true)
    {:ok, _} = BB.subscribe(robot, [:sensor])
  end

  @doc "Stops a process in order; one that is gone is stopped already."
  @spec stop(pid()) :: :ok
  def stop(pid) do
    GenServer.stop(pid)
  catch
    :exit, _gone -> :ok
  end

  defp forget(robot) do
    receive do
      {:bb, _path, %{robot: ^robot}} -> forget(robot)
    after
      0 -> :ok
    end
  end

  # The robot: its options that are to change follow parameters.

  defp declare(robot, setting, place) do
    %{driver: driver, new_options: new} = setting
    options = declared(setting, place)

    params =
      for {key, value} <- new do
        now = Setting.option(driver, options, key)
        quote do: param(unquote(key), type: unquote(type(value)), default: unquote(now))
      end

    options = Enum.reduce(Keyword.keys(new), options, &Keyword.put(&2, &1, reference(&1)))

    code =
      quote do
        use BB

        parameters do
          (unquote_splicing(params))
        end

        sensors do
          sensor(unquote(@subject), {unquote(driver), unquote(quoted(options))},
            max_silence: unquote(Macro.escape(max_silence(setting)))
          )
        end
      end

    # Where it stands is no path of the machine that has compiled this module.
    {:module, ^robot, _, _} = Module.create(robot, code, file: "bench.ex", line: 1)
    :ok
  end

  # Long enough that a busy machine does not look like a silent driver, and short enough that a
  # silent driver is found in time.
  defp max_silence(setting), do: BB.Unit.new!(div(setting.patience_ms, 3), :millisecond)

  defp declared(%{options: options}, place) when is_function(options, 1), do: options.(place)
  defp declared(setting, place), do: Keyword.merge(setting.wires.options(place), setting.options)

  defp reference(key), do: {:reference, key}

  defp quoted(options) do
    for {key, value} <- options do
      case value do
        {:reference, name} -> {key, quote(do: param([unquote(name)]))}
        value -> {key, Macro.escape(value)}
      end
    end
  end

  defp type(value) when is_boolean(value), do: :boolean
  defp type(value) when is_integer(value), do: :integer
  defp type(value) when is_float(value), do: :float
  defp type(value) when is_binary(value), do: :string
  defp type(value) when is_atom(value), do: :atom

  # What can be done

  @doc """
  Begins a fault while no callback of the driver runs, and drops the messages published before.

  Returns the nanoseconds between the newest of those messages and the fault. A driver that waits
  for an edge may have the edge of such a time in its mailbox: a message measured then is a new
  reading from before the fault.
  """
  @spec break(t(), atom(), BB.Message.t()) :: Range.t()
  def break(bench, fault, last_message) do
    pid = pid!(bench)
    :ok = :sys.suspend(pid)
    :ok = bench.setting.wires.break(bench.place, fault)
    broken_ns = System.monotonic_time(:nanosecond)
    times = for message <- [last_message | messages(bench)], do: message.monotonic_time
    forget(bench.robot)
    :sys.resume(pid)
    (Enum.max(times) + 1)..broken_ns//1
  end

  @doc "Ends a fault: the time at which it did."
  @spec mend(t(), atom()) :: integer()
  def mend(bench, fault) do
    now_ns = System.monotonic_time(:nanosecond)
    :ok = bench.setting.wires.mend(bench.place, fault)
    now_ns
  end

  @doc "Changes the driver's options, and waits until they are taken on."
  @spec change(t(), keyword()) :: :ok
  def change(bench, options) do
    pid = pid!(bench)
    :ok = BB.Parameter.set_many(bench.robot, for({key, value} <- options, do: {[key], value}))

    # It has begun with them, so that no tick of its loop is due before it has, and may take the chip's time for it.
    await(bench, "takes on new options", fn -> idle?(pid) end, pass?: false)
    task = Task.async(fn -> answered(pid, bench.setting.patience_ms) end)
    await(bench, "takes on new options", fn -> Task.yield(task, 0) end)
    :ok
  end

  # One that ended by them shows in its row.
  defp answered(pid, timeout_ms) do
    :sys.statistics(pid, :get, timeout_ms)
  catch
    :exit, {reason, _call} when reason != :timeout -> :gone
  end

  defp idle?(pid), do: Process.info(pid, :message_queue_len) in [nil, {:message_queue_len, 0}]

  @doc "Lets stepped time pass, and the driver handle what comes in it."
  @spec pass(t(), non_neg_integer()) :: :ok
  def pass(bench, duration_ns),
    do: Stepped.advance(bench.robot, duration_ns, settle: List.wrap(row(bench).pid))

  # What can be seen

  @doc "Its row of health."
  @spec row(t()) :: map()
  def row(bench), do: hd(BB.Sensor.health(bench.robot))

  @doc "Its process."
  @spec pid!(t()) :: pid()
  def pid!(bench), do: row(bench).pid || raise(Failure, "it is not up: #{inspect(row(bench))}")

  @doc "How many messages it has published."
  @spec published(t()) :: non_neg_integer()
  def published(bench) do
    Enum.sum(for %{path: [:sensor | _], count: count} <- BB.PubSub.topics(bench.robot), do: count)
  end

  @doc "Its statuses since the last look."
  @spec statuses(t()) :: [BB.Message.Sensor.Status.t()]
  def statuses(%{robot: robot} = bench) do
    receive do
      {:bb, [:sensor_status | _], %{robot: ^robot, payload: status}} -> [status | statuses(bench)]
    after
      0 -> []
    end
  end

  @doc "The same, and waits for the first: it comes a moment after its row shows the state."
  @spec await_statuses(t(), String.t()) :: [BB.Message.Sensor.Status.t(), ...]
  def await_statuses(bench, what) do
    await(bench, what, fn -> with [] <- statuses(bench), do: nil end)
  end

  @doc "Its messages since the last look."
  @spec messages(t()) :: [BB.Message.t()]
  def messages(%{robot: robot} = bench) do
    receive do
      {:bb, [:sensor | _], %{robot: ^robot} = message} -> [message | messages(bench)]
    after
      0 -> []
    end
  end

  @doc "Its alarms."
  @spec alarms(t()) :: [term()]
  def alarms(%{robot: robot}),
    do: for({{BB.Sensor, ^robot, _path}, about} <- :alarm_handler.get_alarms(), do: about)

  @doc "Waits until it has so many alarms, and returns them."
  @spec await_alarms(t(), String.t(), non_neg_integer()) :: [term()]
  def await_alarms(bench, what, count) do
    _ = await(bench, what, fn -> length(alarms(bench)) == count end)
    alarms(bench)
  end

  @doc "Waits until it is up: its row."
  @spec await_up(t()) :: map()
  def await_up(bench), do: await(bench, "is up", &(&1.state == :up))

  @doc "Waits until it is not up: its row."
  @spec await_down(t(), String.t()) :: map()
  def await_down(bench, why), do: await(bench, why, &(&1.state not in [:up, :starting]))

  @doc "Waits for a message. Where it takes an event to have one, they are made to happen until there is."
  @spec await_message(t()) :: BB.Message.t()
  def await_message(%{setting: %{event: nil}} = bench), do: await_message(bench, fn -> nil end)

  def await_message(bench) do
    last = :counters.new(1, [])

    await_message(bench, fn ->
      now_ns = System.monotonic_time(:nanosecond)

      if :counters.get(last, 1) == 0 or now_ns - :counters.get(last, 1) > @event_ns do
        :counters.put(last, 1, now_ns)
        happen(bench)
      end
    end)
  end

  defp await_message(bench, happen) do
    await(bench, "publishes", fn ->
      happen.()
      List.first(messages(bench))
    end)
  end

  @doc "Makes the next event happen."
  @spec happen(t()) :: term()
  def happen(bench) do
    :counters.add(bench.events, 1, 1)
    bench.setting.event.(bench.place, :counters.get(bench.events, 1))
  end

  @doc """
  Waits until a look at it, which `fun` may have as its row, gives something true; returns that, or the row where it was `true`. Stepped time goes on meanwhile as the machine's does.
  """
  @spec await(t(), String.t(), (map() -> term()) | (() -> term()), pass?: boolean()) :: term()
  def await(bench, what, fun, opts \\ []) do
    now_ns = System.monotonic_time(:nanosecond)
    pass? = bench.stepped? and Keyword.get(opts, :pass?, true)
    until_ns = now_ns + bench.setting.patience_ms * 1_000_000
    await(bench, what, fun, pass?, until_ns, now_ns)
  end

  defp await(bench, what, fun, pass?, until_ns, last_ns) do
    row = row(bench)
    seen = if is_function(fun, 1), do: fun.(row), else: fun.()
    now_ns = System.monotonic_time(:nanosecond)

    cond do
      seen == true ->
        row

      seen ->
        seen

      now_ns > until_ns ->
        raise Failure,
              "expected that it #{what}, within #{bench.setting.patience_ms} ms; it is #{state(row)}"

      true ->
        Process.sleep(@look_ms)
        # It is not waited for: it may be waiting itself, for its chip.
        if pass?, do: Stepped.advance(bench.robot, now_ns - last_ns)
        await(bench, what, fun, pass?, until_ns, now_ns)
    end
  end

  defp state(%{state: state, error: nil}), do: to_string(state)
  defp state(%{state: state, error: error}), do: "#{state}, last error: #{error}"
end

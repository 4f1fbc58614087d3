defmodule BB.Component.Keeper do
  @moduledoc """
  The process that keeps one component running, so that its faults do not reach other components.

  `BB.Supervisor.Topology` starts one keeper for each sensor, actuator and controller of a robot.
  A keeper is the supervisor of its component, and differs from OTP's in two ways:

    * It restarts the component without limit, after the delays of `BB.Component.Backoff`. A
      component that fails therefore uses up no supervisor's restart budget.
    * It does not wait for the component's `init/1`. A device that does not answer delays neither
      the robot's start nor another component.

  ## States

  The keeper is a state machine. `BB.Component.Lifecycle`, which is pure, decides the next phase
  and the actions for each event. This module turns messages into events and carries out the
  actions.

                  orphan found                    exited, start failed
      ┌─────────┐◄─────────────┌──────────┐──────────────────────────────►┌─────────┐
      │ blocked │              │ starting │                               │ backoff │
      └─────────┘─────────────►└──────────┘◄──────────────────────────────└─────────┘
                 orphan exited   │      │            retry                    ▲  ▲
                              up │      │ exited: ignored                     │  │
                                 ▼      ▼                                     │  │
                        ┌─────────┐    ┌─────────┐                            │  │
                        │ running │    │ ignored │                            │  │
                        └─────────┘    └─────────┘                            │  │
                         │       │ exited                                     │  │
                stopping │       └────────────────────────────────────────────┘  │
                         ▼                                                       │
                        ┌──────────┐ exited                                      │
                        │ stopping │─────────────────────────────────────────────┘
                        └──────────┘

  ## Reports

  The keeper holds a `BB.Component.Status`. On each change of its state it publishes a
  `BB.Message.Sensor.Status` on `[:sensor_status | path]`, sets or clears the OTP alarm
  `{kind, robot, path}`, emits the telemetry event `[:bb, :sensor, :status]`, logs the change
  (`BB.Component.StatusEvents`) and updates its row in `health/1` (`BB.Component.Health`). For
  actuators and controllers, `sensor` is replaced by `actuator` or `controller`.

  ## Silence

  A keeper checks a component with a `max_silence` when that time has passed since the component's
  last activity (`BB.Component.Activity`). While the component is silent, the keeper checks it
  several times in each `max_silence`. The keeper receives none of the component's messages.
  """
  @moduledoc no_example: "internal: a robot's declaration starts its keepers"

  use GenServer
  use BB.Process.Tolerant

  alias BB.Component
  alias BB.Component.{Activity, Health, Heartbeat, Lifecycle, Reason, Server}
  alias BB.Component.{ShutdownLimit, Status, StatusEvents}

  @register_again_ms 10

  # The checks of a silent component in one max_silence, and the bounds of their period.
  @checks_per_silence 4
  @check_ms 5..250

  @enforce_keys [:robot, :component, :lifecycle]
  defstruct [:robot, :component, :lifecycle, :server, :orphan, :timer, :heartbeat, :activity]

  @doc "Returns the child specification of a component's keeper."
  @spec child_spec({module(), Component.t()}) :: Supervisor.child_spec()
  def child_spec({robot, component}) do
    %{
      id: {component.kind.component_kind(), component.name},
      start: {__MODULE__, :start_link, [{robot, component}]},
      type: :supervisor,
      shutdown: :infinity
    }
  end

  @doc "Starts a keeper, which starts its component."
  @spec start_link({module(), Component.t()}) :: GenServer.on_start()
  def start_link({robot, component}), do: GenServer.start_link(__MODULE__, {robot, component})

  @impl GenServer
  def init({robot, component}) do
    Process.flag(:trap_exit, true)
    # Tools that draw supervision trees request the children of each supervisor.
    Process.put(:"$initial_call", {:supervisor, __MODULE__, 1})

    restarts = take_over(robot, component)
    lifecycle = Lifecycle.new(now_ns(), component.max_silence_ns, restarts)
    keeper = %__MODULE__{robot: robot, component: component, lifecycle: lifecycle}
    keeper = register(keeper)
    {:ok, keeper |> start_component() |> report_changes(keeper)}
  end

  # A keeper that died may have left an alarm. Its successor counts one restart more.
  defp take_over(robot, component) do
    case Health.previous(robot, component) do
      nil ->
        0

      {restarts, alarm?} ->
        if alarm?, do: StatusEvents.clear_alarm(robot, component)
        restarts + 1
    end
  end

  @impl GenServer
  def handle_call(:which_children, _from, keeper) do
    {:reply, [{keeper.component.name, child(keeper), :worker, [Server]}], keeper}
  end

  def handle_call(:count_children, _from, keeper) do
    active = if keeper.server, do: 1, else: 0
    {:reply, [specs: 1, active: active, supervisors: 0, workers: 1], keeper}
  end

  def handle_call({:get_childspec, name}, _from, %{component: %{name: name}} = keeper) do
    start = {Server, :start_link, [server_arguments(keeper)]}
    {:reply, {:ok, %{id: name, start: start, restart: :permanent, type: :worker}}, keeper}
  end

  def handle_call({:get_childspec, _other}, _from, keeper),
    do: {:reply, {:error, :not_found}, keeper}

  defp child(%{lifecycle: %{phase: :ignored}}), do: :undefined
  defp child(keeper), do: keeper.server || :restarting

  @impl GenServer
  def handle_info({Server, pid, :up}, %{server: pid} = keeper), do: noreply(keeper, :up)

  def handle_info({Server, pid, {:stopping, _reason}}, %{server: pid} = keeper),
    do: noreply(keeper, :stopping)

  def handle_info({Server, pid, {:trouble, reason}}, %{server: pid} = keeper),
    do: noreply(keeper, {:trouble, reason})

  def handle_info({:EXIT, pid, reason}, %{server: pid} = keeper) do
    outcome = keeper.lifecycle |> Lifecycle.outcome(reason) |> make_showable()
    noreply(%{keeper | server: nil, timer: nil, activity: nil}, {:exited, outcome})
  end

  def handle_info({:EXIT, _pid, :normal}, keeper), do: {:noreply, keeper}

  # The robot's registry or pubsub has exited, and has lost what the keeper had registered there.
  def handle_info({:EXIT, _pid, _reason}, keeper), do: {:noreply, register_later(keeper)}
  def handle_info(:register, keeper), do: {:noreply, register(keeper)}

  def handle_info(:retry, %{server: nil} = keeper), do: noreply(keeper, :retry)

  def handle_info({:DOWN, ref, :process, _pid, _reason}, %{orphan: ref} = keeper),
    do: noreply(%{keeper | orphan: nil}, :orphan_exited)

  def handle_info({:timeout, timer, :check}, %{timer: timer} = keeper),
    do: {:noreply, check_component(%{keeper | timer: nil})}

  def handle_info(_message, keeper), do: {:noreply, keeper}

  @impl GenServer
  def terminate(_reason, keeper) do
    stop_component(keeper)

    if Status.alarm?(keeper.lifecycle.status),
      do: StatusEvents.clear_alarm(keeper.robot, keeper.component)
  end

  # Events and actions

  defp noreply(keeper, event), do: {:noreply, handle_event(keeper, event)}

  defp handle_event(keeper, event), do: keeper |> transition(event) |> report_changes(keeper)

  defp transition(keeper, event) do
    {lifecycle, actions} = Lifecycle.transition(keeper.lifecycle, event, now_ns())
    Enum.reduce(actions, %{keeper | lifecycle: lifecycle}, &run_action/2)
  end

  defp run_action(:start, keeper), do: start_component(keeper)
  defp run_action({:watch_init, timeout_ms}, keeper), do: start_timer(keeper, timeout_ms)
  defp run_action(:watch_activity, keeper), do: watch_activity(keeper, now_ns())

  defp run_action({:retry_after, delay_ms}, keeper) do
    Process.send_after(self(), :retry, delay_ms)
    keeper
  end

  defp report_changes(keeper, %{lifecycle: %{status: old}} = before) do
    format = &Reason.format(&1, keeper.component.module)
    status = Status.put_error_text(keeper.lifecycle.status, old, format)
    keeper = %{keeper | lifecycle: %{keeper.lifecycle | status: status}}

    if {status, keeper.server} != {old, before.server},
      do: Health.put(keeper.robot, keeper.component, status, keeper.server)

    if Status.changed?(old, status),
      do: StatusEvents.emit(keeper.robot, keeper.component, old, status)

    keeper
  end

  # The component's process

  defp start_component(keeper) do
    keeper = %{keeper | heartbeat: Heartbeat.new(keeper.component.max_silence_ns)}

    case start_server(keeper) do
      {:ok, pid} ->
        transition(%{keeper | server: pid}, :started)

      # The orphan has to be gone before another process may have its device.
      {:error, {:already_started, pid}} ->
        Process.exit(pid, :kill)
        transition(%{keeper | orphan: Process.monitor(pid)}, :orphan_found)

      {:error, reason} ->
        transition(keeper, {:start_failed, reason})
    end
  end

  defp start_server(keeper) do
    keeper |> server_arguments() |> Server.start_link()
  rescue
    # The registry is being restarted.
    error in ArgumentError -> {:error, error}
  end

  defp server_arguments(%{robot: robot, component: component, heartbeat: heartbeat}) do
    [
      __callback_module__: component.module,
      __kind__: component.kind,
      __keeper__: self(),
      __heartbeat__: heartbeat,
      bb: %{robot: robot, path: component.path}
    ] ++ component.options
  end

  # Any process may have sent the reason of a crash. BB.Component.Server has checked the others.
  defp make_showable({:crash, reason}), do: {:crash, Reason.showable(reason)}
  defp make_showable(outcome), do: outcome

  defp stop_component(%{server: nil}), do: :ok

  # Before init/1 has returned terminate/2 has nothing to do. A component that has just come up
  # may hold something that only terminate/2 releases.
  defp stop_component(%{server: pid, lifecycle: %{phase: :starting}} = keeper) do
    receive do
      {Server, ^pid, :up} -> stop_server(keeper)
    after
      0 -> kill(pid)
    end
  end

  defp stop_component(keeper), do: stop_server(keeper)

  # A system message runs terminate/2 in a process that does not trap exits.
  defp stop_server(%{server: pid, heartbeat: heartbeat} = keeper) do
    limit_ms = ShutdownLimit.limit_ms(keeper.robot, Heartbeat.shutdown_ms(heartbeat))
    GenServer.stop(pid, :shutdown, limit_ms)
  catch
    :exit, reason ->
      ShutdownLimit.record(keeper.robot, reason)
      kill(pid)
  end

  defp kill(pid) do
    ref = Process.monitor(pid)
    Process.exit(pid, :kill)

    receive do
      {:DOWN, ^ref, :process, ^pid, _reason} -> :ok
    end
  end

  # Silence

  defp watch_activity(%{component: %{max_silence_ns: nil}} = keeper, _now_ns),
    do: %{keeper | activity: nil, timer: nil}

  defp watch_activity(%{component: component} = keeper, now_ns) do
    path = Component.data_path(component)
    activity = Activity.new(keeper.robot, path, keeper.heartbeat, now_ns)
    schedule_check(%{keeper | activity: activity}, now_ns)
  end

  defp check_component(%{lifecycle: %{phase: :starting}} = keeper),
    do: handle_event(keeper, :init_timeout)

  defp check_component(%{activity: %Activity{last_ns: previous_ns}} = keeper) do
    now_ns = now_ns()
    activity = Activity.update(keeper.activity, now_ns)

    %{keeper | activity: activity}
    |> handle_event({:activity_checked, previous_ns, activity.last_ns})
    |> schedule_check(now_ns)
  end

  defp schedule_check(%{lifecycle: %{status: %{state: :stale}}} = keeper, _now_ns) do
    period_ms = div(keeper.component.max_silence_ns, @checks_per_silence * 1_000_000)
    start_timer(keeper, period_ms |> max(@check_ms.first) |> min(@check_ms.last))
  end

  defp schedule_check(keeper, now_ns) do
    left_ns = keeper.activity.last_ns + keeper.component.max_silence_ns - now_ns
    start_timer(keeper, max(div(left_ns + 999_999, 1_000_000), 0))
  end

  defp start_timer(keeper, after_ms),
    do: %{keeper | timer: :erlang.start_timer(after_ms, self(), :check)}

  # The registry

  # The keeper's row in the registry lives as long as the registry does.
  defp register(keeper) do
    %{robot: robot, component: component, lifecycle: %{status: status}} = keeper
    if component.retain, do: BB.PubSub.retain(robot, Component.data_path(component))
    registered = Health.register(robot, component, status, keeper.server)
    if registered == :ok, do: keeper, else: register_later(keeper)
  rescue
    ArgumentError -> register_later(keeper)
  end

  defp register_later(keeper) do
    Process.send_after(self(), :register, @register_again_ms)
    keeper
  end

  defp now_ns, do: System.monotonic_time(:nanosecond)
end

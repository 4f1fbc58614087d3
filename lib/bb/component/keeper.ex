defmodule BB.Component.Keeper do
  @moduledoc """
  Keeps one component running, so that its faults reach nobody else.

  The keeper is a component's supervisor, with two differences from OTP's: it starts a component again for ever, after the
  delays of `BB.Component.Backoff`, and so uses no supervisor's restart budget; and it does not wait for the component's
  `init/1`, so that a device which does not answer holds up neither the robot's start nor another component.

  What it knows of the component is a `BB.Component.Status`. On each change of state it publishes a
  `BB.Message.Sensor.Status` on `[:sensor_status | path]`, sets or clears the OTP alarm `{kind, robot, path}`, emits the
  telemetry event `[:bb, :sensor, :status]`, logs, and renews its row in `health/2` (for other kinds of components their
  word stands in the place of `sensor`).

  A component with a `max_silence` is looked after when that has passed since it was heard of last
  (`BB.Component.Activity`); while it is silent, several times in that span. The keeper gets none
  of its messages.
  """

  use GenServer
  use BB.Process.Tolerant

  alias BB.Component

  alias BB.Component.{
    Activity,
    Health,
    Heartbeat,
    Reason,
    Server,
    ShutdownLimit,
    Status,
    StatusEvents
  }

  @init_timeout_ms 5_000
  @attach_ms 10

  # How often a silent component is looked after: so often in its max_silence, within these
  # bounds.
  @looks 4
  @looks_ms 5..250

  @enforce_keys [:robot, :component, :status]
  defstruct [
    :robot,
    :component,
    :status,
    :server,
    :predecessor,
    :watch,
    :heartbeat,
    :activity,
    ready?: false,
    stopping?: false
  ]

  @doc "A permanent place for the component under a supervisor of the robot's tree."
  @spec child_spec({module(), Component.t()}) :: Supervisor.child_spec()
  def child_spec({robot, component}) do
    %{
      id: {component.kind.component_kind(), component.name},
      start: {__MODULE__, :start_link, [{robot, component}]},
      type: :supervisor,
      shutdown: :infinity
    }
  end

  @doc "Starts the keeper and its component."
  @spec start_link({module(), Component.t()}) :: GenServer.on_start()
  def start_link({robot, component}), do: GenServer.start_link(__MODULE__, {robot, component})

  @impl GenServer
  def init({robot, component}) do
    Process.flag(:trap_exit, true)
    # Tools that draw supervision trees ask a supervisor for its children.
    Process.put(:"$initial_call", {:supervisor, __MODULE__, 1})

    status = Status.new(now_ns(), inherit(robot, component))
    keeper = %__MODULE__{robot: robot, component: component, status: status}
    {:ok, keeper |> attach() |> start()}
  end

  defp inherit(robot, component) do
    case Health.left(robot, component) do
      nil ->
        0

      {restarts, alarming?} ->
        if alarming?, do: StatusEvents.clear_alarm(robot, component)
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
    start = {Server, :start_link, [arguments(keeper)]}
    {:reply, {:ok, %{id: name, start: start, restart: :permanent, type: :worker}}, keeper}
  end

  def handle_call({:get_childspec, _other}, _from, keeper),
    do: {:reply, {:error, :not_found}, keeper}

  defp child(%{status: %{state: :ignored}}), do: :undefined
  defp child(keeper), do: keeper.server || :restarting

  @impl GenServer
  def handle_info({Server, pid, :up}, %{server: pid} = keeper) do
    now_ns = now_ns()

    %{keeper | ready?: true, activity: listen(keeper, now_ns)}
    |> become(Status.up(keeper.status, now_ns))
    |> watch_silence(now_ns)
    |> noreply()
  end

  def handle_info({Server, pid, {:stopping, _reason}}, %{server: pid} = keeper),
    do: noreply(%{keeper | stopping?: true})

  def handle_info({Server, pid, {:trouble, reason}}, %{server: pid} = keeper),
    do: keeper |> become(Status.troubled(keeper.status, reason)) |> noreply()

  def handle_info({:EXIT, pid, reason}, %{server: pid} = keeper),
    do: %{keeper | server: nil, ready?: false, watch: nil} |> ended(reason) |> noreply()

  def handle_info({:EXIT, _pid, :normal}, keeper), do: noreply(keeper)

  # The robot's registry or bus went down and took what the keeper had there with it.
  def handle_info({:EXIT, _pid, _reason}, keeper), do: noreply(attach_later(keeper))
  def handle_info(:attach, keeper), do: keeper |> attach() |> noreply()

  def handle_info(:retry, %{server: nil} = keeper),
    do:
      %{keeper | status: Status.restarted(keeper.status, now_ns())}
      |> start()
      |> noreply()

  def handle_info({:DOWN, ref, :process, _pid, _reason}, %{predecessor: ref} = keeper),
    do: %{keeper | predecessor: nil} |> start() |> noreply()

  def handle_info({:timeout, watch, :watch}, %{watch: watch} = keeper),
    do: %{keeper | watch: nil} |> check_silence(now_ns()) |> noreply()

  def handle_info(_message, keeper), do: noreply(keeper)

  @impl GenServer
  def terminate(_reason, keeper) do
    stop_server(keeper)

    if Status.alarming?(keeper.status),
      do: StatusEvents.clear_alarm(keeper.robot, keeper.component)
  end

  # Starting

  defp start(keeper) do
    keeper = %{keeper | heartbeat: Heartbeat.new(keeper.component.max_silence_ns)}

    case start_server(keeper) do
      {:ok, pid} ->
        %{keeper | server: pid, ready?: false, stopping?: false}
        |> watch(@init_timeout_ms)
        |> become(keeper.status)

      # What a killed keeper left behind has to be gone before another may have its device.
      {:error, {:already_started, pid}} ->
        Process.exit(pid, :kill)
        %{keeper | predecessor: Process.monitor(pid)}

      {:error, reason} ->
        down(keeper, :absent, reason)
    end
  end

  defp start_server(keeper) do
    keeper |> arguments() |> Server.start_link()
  rescue
    # The registry is being restarted.
    error in ArgumentError -> {:error, error}
  end

  defp arguments(%{robot: robot, component: component, heartbeat: heartbeat}) do
    [
      __callback_module__: component.module,
      __kind__: component.kind,
      __keeper__: self(),
      __heartbeat__: heartbeat,
      bb: %{robot: robot, path: component.path}
    ] ++ component.options
  end

  # Ending

  defp ended(keeper, {:shutdown, {Server, {:absent, reason}}}), do: down(keeper, :absent, reason)

  defp ended(keeper, {:shutdown, {Server, :ignored}}),
    do: become(keeper, Status.ignored(keeper.status, now_ns()))

  defp ended(%{stopping?: true} = keeper, reason), do: down(keeper, :absent, reason)
  defp ended(keeper, reason), do: down(keeper, :crash, Reason.received(reason))

  defp down(keeper, cause, reason) do
    status = Status.down(keeper.status, cause, reason, now_ns())
    Process.send_after(self(), :retry, status.retry_in_ms)
    become(keeper, status)
  end

  # Terminating by a message runs terminate/2 in a process that does not trap exits; init has
  # nothing to terminate yet.
  defp stop_server(%{server: nil}), do: :ok

  # What has just come up may hold something that only terminate/2 gives back.
  defp stop_server(%{server: pid, ready?: false} = keeper) do
    receive do
      {Server, ^pid, :up} -> stop_server(%{keeper | ready?: true})
    after
      0 -> kill(pid)
    end
  end

  defp stop_server(%{server: pid, heartbeat: heartbeat} = keeper) do
    limit_ms = ShutdownLimit.limit_ms(keeper.robot, Heartbeat.shutdown_ms(heartbeat))
    GenServer.stop(pid, :shutdown, limit_ms)
  catch
    :exit, reason ->
      ShutdownLimit.ended(keeper.robot, reason)
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

  defp listen(%{component: %{max_silence_ns: nil}}, _now_ns), do: nil

  defp listen(keeper, now_ns),
    do:
      Activity.new(keeper.robot, Component.data_path(keeper.component), keeper.heartbeat, now_ns)

  defp watch_silence(%{activity: nil} = keeper, _now_ns), do: %{keeper | watch: nil}

  defp watch_silence(%{status: %{state: :stale}} = keeper, _now_ns) do
    often_ms = div(keeper.component.max_silence_ns, @looks * 1_000_000)
    watch(keeper, often_ms |> max(@looks_ms.first) |> min(@looks_ms.last))
  end

  defp watch_silence(keeper, now_ns) do
    left_ns = keeper.activity.heard_ns + keeper.component.max_silence_ns - now_ns
    watch(keeper, max(div(left_ns + 999_999, 1_000_000), 0))
  end

  defp watch(keeper, after_ms),
    do: %{keeper | watch: :erlang.start_timer(after_ms, self(), :watch)}

  defp check_silence(%{server: nil} = keeper, _now_ns), do: keeper

  defp check_silence(%{ready?: false} = keeper, now_ns),
    do:
      become(
        keeper,
        Status.silent(keeper.status, {:init_timeout, @init_timeout_ms}, now_ns)
      )

  # A watch over its init that was still on its way when it came up.
  defp check_silence(%{activity: nil} = keeper, _now_ns), do: keeper

  defp check_silence(keeper, now_ns) do
    activity = Activity.look(keeper.activity, now_ns)

    %{keeper | activity: activity}
    |> become_if_changed(judge(keeper, activity, now_ns))
    |> watch_silence(now_ns)
  end

  # What is stale is up with its next message, be that old when it is found: then it is stale
  # again at once.
  defp judge(
         %{status: %{state: :stale}, activity: %{heard_ns: before_ns}} = keeper,
         activity,
         now_ns
       )
       when activity.heard_ns > before_ns,
       do: Status.heard(keeper.status, now_ns)

  defp judge(%{status: status, component: %{max_silence_ns: max_ns}}, activity, now_ns) do
    if now_ns - activity.heard_ns >= max_ns,
      do: Status.silent(status, {:silent, div(max_ns, 1_000_000)}, now_ns),
      else: Status.heard(status, now_ns)
  end

  # Telling

  defp become_if_changed(%{status: status} = keeper, status), do: keeper
  defp become_if_changed(keeper, status), do: become(keeper, status)

  defp become(keeper, status) do
    old = keeper.status
    status = Status.explain(old, status, &Reason.words(&1, keeper.component.module))
    keeper = %{keeper | status: status}
    Health.put(keeper.robot, keeper.component, status, keeper.server)

    if Status.news?(old, status),
      do: StatusEvents.emit(keeper.robot, keeper.component, old, status)

    keeper
  end

  # Its row in the registry lives as long as the registry does.
  defp attach(keeper) do
    %{robot: robot, component: component, status: status} = keeper
    if component.retain, do: BB.PubSub.retain(robot, Component.data_path(component))
    registered = Health.register(robot, component, status, keeper.server)
    if registered == :ok, do: keeper, else: attach_later(keeper)
  rescue
    ArgumentError -> attach_later(keeper)
  end

  defp attach_later(keeper) do
    Process.send_after(self(), :attach, @attach_ms)
    keeper
  end

  defp now_ns, do: System.monotonic_time(:nanosecond)
  defp noreply(keeper), do: {:noreply, keeper}
end

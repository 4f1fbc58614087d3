defmodule BB.Safety.Warden do
  @moduledoc """
  Decides about one robot's safety, and runs its disarmings. It stands outside the robot's own
  processes and watches them.

  It holds nothing that is not in `BB.Safety.Records`: one that is killed has a successor, which
  goes on where it stopped, also in the midst of a disarming. It calls no code of a user's:
  telemetry handlers and `disarm/1` callbacks run in processes of their own.

  It is there from the start of the robot until the robot has ended and is disarmed. Whom it
  watches follows from the tables alone (`attend/1`), by whatever way it or those whom it watches
  have come: root and topology supervisor, and who vouches for a path.
  """

  use GenServer, restart: :transient
  use BB.Process.Tolerant

  alias BB.Safety.{Events, Record, Records, Round}

  @supervisor BB.Safety.Wardens
  @timeout_ms 5_000
  @again_ms 5
  @patience_ms 10_000

  @enforce_keys [:record]
  defstruct [:record, :deadline, watched: %{}, runs: %{}, waiting: []]

  @type role :: Record.role() | :component | {:voucher, [atom()]}

  @typedoc "Greater than the epoch of each arming before, less than that of each arming after it."
  @type moment :: pos_integer()

  # What others ask

  @doc "How long handlers may take when nothing is said."
  def default_timeout_ms, do: @timeout_ms

  @doc """
  Has the calling process watched: a robot's `:root` or `:topology`, whose end disarms the robot.
  A `:component` stands in for the root of a robot that has none, as one does that is started
  alone.
  """
  @spec watch(module(), role()) :: :ok
  def watch(robot, role) do
    unless Records.running?(),
      do: raise("BB.Safety is not running: start the application :ganglion before a robot")

    pid = self()
    persist(fn _attempt -> watched_by(robot, role, pid) end)
  end

  @doc "Has the calling process vouch for a path: from its end on that path inhibits arming, and an armed robot is disarmed."
  @spec vouch(module(), [atom()]) :: :ok
  def vouch(robot, path) do
    pid = self()

    persist(fn _attempt ->
      unless Records.known?(robot), do: watch(robot, :component)
      GenServer.call(name(robot), {:vouch, path, pid}, :infinity)
    end)
  end

  @doc "Arms the robot."
  @spec arm(module()) :: :ok | {:error, term()}
  def arm(robot) do
    ref = make_ref()
    seen = with {:ok, epoch} <- Records.epoch(robot), do: epoch
    request(robot, {:arm, ref, :first}, {:arm, ref, seen})
  end

  @doc "Disarms the robot: the answer comes when its handlers are done."
  @spec disarm(module(), pos_integer()) :: :ok | {:error, term()}
  def disarm(robot, timeout_ms), do: request(robot, {:disarm, make_ref(), timeout_ms})

  @doc "Takes a robot out of its error."
  @spec force_disarm(module()) :: :ok | {:error, term()}
  def force_disarm(robot), do: request(robot, {:force_disarm, make_ref()})

  @doc """
  Disarms a robot that was armed before a moment, and waits for a disarming that is under way. A
  robot that was armed later stays armed: what was to be made safe is not what is armed now.
  """
  @spec secure(module(), moment()) :: :ok | {:error, term()}
  def secure(robot, moment \\ moment()), do: request(robot, {:secure, moment})

  @doc "Now, among the epochs of all robots."
  @spec moment() :: moment()
  def moment, do: System.unique_integer([:positive, :monotonic])

  # One that has a record takes no role from its start, which may be a repeated one.
  defp watched_by(robot, role, pid) do
    _ = start(robot, role, pid)
    GenServer.call(name(robot), {:watch, role, pid}, :infinity)
  end

  defp start(robot, role, pid),
    do: DynamicSupervisor.start_child(@supervisor, {__MODULE__, {robot, role, pid}})

  # A warden that dies has a successor, which is asked again and knows what became of the request.
  defp request(robot, request), do: request(robot, request, request)

  defp request(robot, request, again) do
    persist(fn attempt ->
      if Records.known?(robot),
        do: GenServer.call(name(robot), if(attempt == 1, do: request, else: again), :infinity),
        else: {:error, :not_registered}
    end)
  end

  defp persist(fun), do: persist(fun, 1, System.monotonic_time(:millisecond) + @patience_ms)

  defp persist(fun, attempt, until_ms) do
    fun.(attempt)
  catch
    :exit, reason ->
      if System.monotonic_time(:millisecond) > until_ms, do: exit(reason)
      Process.sleep(@again_ms)
      BB.Safety.Supervisor.start()
      persist(fun, attempt + 1, until_ms)
  end

  # The process

  @doc """
  Starts the warden of a robot, for which `pid` has a role. `:ignore` when it runs: its supervisor
  may have started it anew before someone who needs it could, or the other way round, and neither
  is a failure. One that a killed supervisor has left behind is ended: it need not end by itself,
  for a supervisor that is killed while it stops its children has let go of them already.
  """
  @spec start_link({module(), role() | :nobody, pid() | nil}) :: GenServer.on_start()
  def start_link({robot, _role, _pid} = argument) do
    with {:error, {:already_started, warden}} <-
           GenServer.start_link(__MODULE__, argument, name: name(robot)) do
      if sibling?(warden), do: :ignore, else: start_after(warden, argument)
    end
  end

  defp sibling?(warden) do
    {:links, links} = Process.info(self(), :links)
    warden in links
  end

  defp start_after(warden, argument) do
    ref = Process.monitor(warden)
    Process.exit(warden, :kill)
    receive do: ({:DOWN, ^ref, :process, ^warden, _reason} -> start_link(argument))
  end

  @doc "Starts the warden of a robot with a record, unless it runs."
  @spec resume(Record.t()) :: :ok
  def resume(%{robot: robot}) do
    persist(fn _attempt ->
      _ = start(robot, :nobody, nil)
      :ok
    end)
  end

  defp name(robot), do: Module.concat(robot, Safety)

  @impl GenServer
  def init({robot, role, pid}) do
    # An emergency stop does not queue behind what the robot computes.
    Process.flag(:priority, :high)

    case {Records.record(robot), role} do
      {nil, :nobody} -> :ignore
      {nil, role} -> {:ok, watch_role(%__MODULE__{record: %Record{robot: robot}}, role, pid)}
      {record, _role} -> {:ok, go_on(%__MODULE__{record: record}), {:continue, :settle}}
    end
  end

  # What another process began: who was watched is watched again, and a round is continued.
  defp go_on(%{record: record} = warden) do
    Records.clear_runs(record.robot, record.round && record.round.id)
    warden |> attend() |> run()
  end

  @impl GenServer
  def handle_continue(:settle, warden), do: warden |> settle() |> noreply()

  @impl GenServer
  def handle_call({:watch, role, pid}, _from, warden),
    do: {:reply, :ok, watch_role(warden, role, pid)}

  def handle_call({:vouch, path, pid}, _from, %{record: record} = warden) do
    Records.vouch(record.robot, path, pid)
    {:reply, :ok, attend(warden)}
  end

  def handle_call({:arm, ref, seen}, _from, %{record: record} = warden) do
    epoch = moment()
    forbidden = if Records.hosted?(), do: Records.inhibitions(record.robot), else: :not_running

    case Record.arm(record, ref, seen, epoch, forbidden) do
      {:ok, record} -> {:reply, :ok, become(warden, record)}
      {:error, reason} -> {:reply, {:error, reason}, warden}
    end
  end

  def handle_call({:disarm, ref, timeout_ms}, from, %{record: record} = warden) do
    case Record.disarm(record, ref) do
      :begin -> warden |> wait(from) |> disarm(ref, timeout_ms, :requested) |> noreply()
      :wait -> warden |> wait(from) |> noreply()
      answer -> {:reply, answer, warden}
    end
  end

  def handle_call({:force_disarm, ref}, _from, %{record: record} = warden) do
    case Record.force_disarm(record, ref) do
      {:ok, record} -> warden |> become(record) |> reply(:ok)
      error -> {:reply, error, warden}
    end
  end

  def handle_call({:secure, moment}, from, %{record: record} = warden) do
    case record do
      %{state: :armed, epoch: epoch} when epoch < moment ->
        warden |> wait(from) |> disarm(nil, @timeout_ms, :shutdown) |> noreply()

      %{state: :disarming} ->
        warden |> wait(from) |> noreply()

      _safe_or_in_error_or_armed_later ->
        {:reply, :ok, warden}
    end
  end

  @impl GenServer
  def handle_info({:DOWN, ref, :process, pid, reason}, %{runs: runs} = warden)
      when is_map_key(runs, ref) do
    {key, runs} = Map.pop!(runs, ref)

    case Round.ended(key, pid, reason) do
      :done -> noreply(settle(%{warden | runs: runs}))
      ref -> noreply(%{warden | runs: Map.put(runs, ref, key)})
    end
  end

  def handle_info({:DOWN, ref, :process, pid, _reason}, warden) do
    case Enum.find(warden.watched, &match?({_watched, ^ref}, &1)) do
      {{role, ^pid} = gone, ^ref} ->
        noreply(lost(%{warden | watched: Map.delete(warden.watched, gone)}, role, pid))

      nil ->
        noreply(warden)
    end
  end

  def handle_info({:timeout, deadline, :deadline}, %{deadline: deadline} = warden),
    do: noreply(finish(warden))

  def handle_info(_message, warden), do: noreply(warden)

  # Who is watched

  # Who takes the place of another that is watched brings the news of its death. What follows from
  # that is kept before the new one is, so that nothing is forgotten when the warden dies here.

  defp watch_role(%{record: %{root: nil}} = warden, :component, pid),
    do: watch_role(warden, :root, pid)

  defp watch_role(warden, :component, _pid), do: warden

  defp watch_role(warden, role, pid) do
    case Map.fetch!(warden.record, role) do
      ^pid -> warden
      nil -> enter(warden, role, pid)
      _dead -> warden |> disarm(nil, @timeout_ms, {role, :ended}) |> enter(role, pid)
    end
  end

  # Handlers that nobody's end has removed: of components that were started alone, or outlived
  # their robot.
  defp enter(%{record: record} = warden, role, pid) do
    if role == :root and record.state == :disarmed, do: Records.sweep(record.robot)
    become(warden, Record.enter(record, role, pid))
  end

  # The one place where anybody is watched.
  defp attend(%{record: record, watched: watched} = warden) do
    wanted = Record.watched(record) ++ vouchers(record.robot)
    {kept, dropped} = Map.split(watched, wanted)
    for {_who, ref} <- dropped, do: Process.demonitor(ref, [:flush])

    new =
      for {_role, pid} = who <- wanted, not is_map_key(kept, who), do: {who, Process.monitor(pid)}

    %{warden | watched: Map.merge(kept, Map.new(new))}
  end

  defp vouchers(robot),
    do: for({path, pid} <- Records.vouchers(robot), do: {{:voucher, path}, pid})

  # The table keeps that it has ended after it keeps what follows from that, so that a successor
  # finds what is still to be done.
  defp lost(warden, {:voucher, path} = role, pid) do
    robot = warden.record.robot
    vouched? = Records.voucher?(robot, path, pid)
    warden = if vouched?, do: disarm(warden, nil, @timeout_ms, {role, :ended}), else: warden
    Records.unattended(robot, path, pid)
    attend(warden)
  end

  defp lost(warden, role, _pid) do
    warden = disarm(warden, nil, @timeout_ms, {role, :ended})
    become(warden, Map.put(warden.record, role, nil))
  end

  # Disarming

  defp disarm(%{record: %{state: :armed} = record} = warden, ref, timeout_ms, cause) do
    round = Round.new(record.robot, timeout_ms, cause)
    disarming = Record.disarming(record, ref, round)
    Records.put(disarming)
    warden = run(%{warden | record: disarming})
    Events.transition(record, disarming)
    Events.began(record.robot, round)
    settle(warden)
  end

  defp disarm(warden, _ref, _timeout_ms, _cause), do: warden

  defp run(%{record: %{round: nil}} = warden), do: warden

  defp run(%{record: %{round: round, robot: robot}} = warden) do
    deadline = :erlang.start_timer(round.deadline_ms, self(), :deadline, abs: true)
    %{warden | runs: Round.go_on(round, robot), deadline: deadline}
  end

  defp settle(%{runs: runs, record: %{state: :disarming}} = warden) when runs == %{},
    do: finish(warden)

  defp settle(warden), do: warden

  defp finish(%{record: %{robot: robot, round: round}} = warden) do
    for {ref, _key} <- warden.runs, do: Process.demonitor(ref, [:flush])
    _ = :erlang.cancel_timer(warden.deadline)
    failures = Round.close(round, robot)

    warden =
      become(%{warden | runs: %{}, deadline: nil}, Record.disarmed(warden.record, failures))

    Records.clear_runs(robot, nil)
    Events.ended(robot, round, failures)
    for from <- warden.waiting, do: GenServer.reply(from, Record.outcome(warden.record))
    %{warden | waiting: []}
  end

  defp wait(warden, from), do: %{warden | waiting: [from | warden.waiting]}

  # Changing

  defp become(%{record: old} = warden, record) do
    Records.put(record)
    if old.state != record.state, do: Events.transition(old, record)
    attend(%{warden | record: record})
  end

  # Returning: a robot that has ended and is disarmed needs nobody.

  defp noreply(warden) do
    if over?(warden), do: {:stop, :normal, warden}, else: {:noreply, warden}
  end

  defp reply(warden, answer) do
    if over?(warden), do: {:stop, :normal, answer, warden}, else: {:reply, answer, warden}
  end

  defp over?(%{record: record}) do
    over? = Record.over?(record)
    if over?, do: Records.forget(record.robot)
    over?
  end
end

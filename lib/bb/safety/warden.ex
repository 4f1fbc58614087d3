defmodule BB.Safety.Warden do
  @moduledoc """
  Decides about one robot's safety and runs its disarmings, outside of the robot's own processes.
  `BB.Safety` calls it through `BB.Safety.Wardens`.

  All its knowledge is in `BB.Safety.Records`: the successor of a killed warden continues where
  the warden stopped, also in the middle of a disarming. A warden calls no code of a user:
  telemetry handlers and `disarm/1` callbacks run in processes of their own.

  A warden lives from the start of the robot until the robot has ended and is disarmed. It
  monitors the root supervisor, the topology supervisor and the vouchers, which it reads from
  the tables alone (`update_monitors/1`).
  """
  @moduledoc no_example: "internal: BB.Safety is its interface"

  use GenServer, restart: :transient
  use BB.Process.Tolerant

  alias BB.Safety.{Events, Record, Records, Round}

  @timeout_ms 5_000

  @enforce_keys [:record]
  defstruct [:record, :deadline, watched: %{}, runs: %{}, waiting: []]

  @type role :: Record.role() | :component | {:voucher, [atom()]}

  @typedoc "A moment is greater than each epoch before it, and less than each epoch after it."
  @type moment :: pos_integer()

  @doc "Returns the default timeout of handlers in milliseconds."
  @spec default_timeout_ms() :: pos_integer()
  def default_timeout_ms, do: @timeout_ms

  @doc "Returns the present moment, comparable with the epochs of all robots."
  @spec moment() :: moment()
  def moment, do: System.unique_integer([:positive, :monotonic])

  @doc """
  Starts the warden of a robot, in which `pid` has a role.

  Returns `:ignore` when the warden runs: its supervisor and a caller may both start it. Kills a
  warden that a killed supervisor has left behind: such an orphan may not end by itself, because a
  supervisor that is killed while it stops its children has unlinked them already.
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

  @doc "Returns the registered name of a robot's warden."
  @spec name(module()) :: module()
  def name(robot), do: Module.concat(robot, Safety)

  @impl GenServer
  def init({robot, role, pid}) do
    # An emergency stop must not wait for the computations of the robot.
    Process.flag(:priority, :high)

    case {Records.record(robot), role} do
      {nil, :nobody} ->
        :ignore

      {nil, role} ->
        {:ok, watch_role(%__MODULE__{record: %Record{robot: robot}}, role, pid)}

      {record, _role} ->
        {:ok, resume_record(%__MODULE__{record: record}), {:continue, :finish_if_done}}
    end
  end

  # Continues the work of a predecessor: its monitors and its round.
  defp resume_record(%{record: record} = warden) do
    Records.clear_runs(record.robot, record.round && record.round.id)
    warden |> update_monitors() |> run()
  end

  @impl GenServer
  def handle_continue(:finish_if_done, warden), do: warden |> finish_if_done() |> noreply()

  @impl GenServer
  def handle_call({:watch, role, pid}, _from, warden),
    do: {:reply, :ok, watch_role(warden, role, pid)}

  def handle_call({:vouch, path, pid}, _from, %{record: record} = warden) do
    Records.vouch(record.robot, path, pid)
    {:reply, :ok, update_monitors(warden)}
  end

  def handle_call({:arm, ref, seen}, _from, %{record: record} = warden) do
    epoch = moment()
    forbidden = if Records.hosted?(), do: Records.inhibitions(record.robot), else: :not_running

    case Record.arm(record, ref, seen, epoch, forbidden) do
      {:ok, record} -> {:reply, :ok, put_record(warden, record)}
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
      {:ok, record} -> warden |> put_record(record) |> reply(:ok)
      error -> {:reply, error, warden}
    end
  end

  def handle_call(:fail, from, %{record: record} = warden) do
    case Record.fail(record) do
      :begin -> warden |> wait(from) |> disarm(nil, @timeout_ms, :failure) |> noreply()
      :wait -> warden |> wait(from) |> noreply()
      answer -> {:reply, answer, warden}
    end
  end

  # The end of the topology has no effect from now on. A topology that has ended before has died.
  def handle_call({:stopping, root}, _from, %{record: %{root: root}} = warden) do
    %{record: record} = warden = handle_dead_topology(warden)
    {:reply, :ok, put_record(warden, %{record | topology: nil})}
  end

  def handle_call({:stopping, _former_root}, _from, warden), do: {:reply, :ok, warden}

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

    case Round.handle_down(key, pid, reason) do
      :done -> noreply(finish_if_done(%{warden | runs: runs}))
      ref -> noreply(%{warden | runs: Map.put(runs, ref, key)})
    end
  end

  def handle_info({:DOWN, ref, :process, pid, _reason}, warden) do
    case Enum.find(warden.watched, &match?({_watched, ^ref}, &1)) do
      {{role, ^pid} = ended, ^ref} ->
        noreply(handle_end(%{warden | watched: Map.delete(warden.watched, ended)}, role, pid))

      nil ->
        noreply(warden)
    end
  end

  def handle_info({:timeout, deadline, :deadline}, %{deadline: deadline} = warden),
    do: noreply(finish(warden))

  def handle_info(_message, warden), do: noreply(warden)

  # Monitors

  # A process that takes the role of another shows that the other is dead. The effects of that
  # death are stored before the new process is, so that none is lost when the warden dies here.

  defp watch_role(%{record: %{root: nil}} = warden, :component, pid),
    do: watch_role(warden, :root, pid)

  defp watch_role(warden, :component, _pid), do: warden

  defp watch_role(warden, role, pid) do
    case Map.fetch!(warden.record, role) do
      ^pid -> warden
      nil -> enter(warden, role, pid)
      _former when role == :topology -> warden |> handle_dead_topology() |> enter(role, pid)
      _dead -> warden |> disarm(nil, @timeout_ms, {role, :ended}) |> enter(role, pid)
    end
  end

  # Removes handlers of dead processes: of components that were started alone, or outlived their
  # robot.
  defp enter(%{record: record} = warden, role, pid) do
    if role == :root and record.state == :disarmed, do: Records.sweep(record.robot)
    put_record(warden, Record.enter(record, role, pid))
  end

  # Monitors the processes of the record and the vouchers, and no others.
  defp update_monitors(%{record: record, watched: watched} = warden) do
    wanted = Record.watched(record) ++ vouchers(record.robot)
    {kept, dropped} = Map.split(watched, wanted)
    for {_process, ref} <- dropped, do: Process.demonitor(ref, [:flush])

    new =
      for {_role, pid} = key <- wanted, not is_map_key(kept, key), do: {key, Process.monitor(pid)}

    %{warden | watched: Map.merge(kept, Map.new(new))}
  end

  defp vouchers(robot),
    do: for({path, pid} <- Records.vouchers(robot), do: {{:voucher, path}, pid})

  # The end of the voucher is stored after its effects, so that a successor finds what is left
  # to do.
  defp handle_end(warden, {:voucher, path} = role, pid) do
    robot = warden.record.robot
    vouched? = Records.voucher?(robot, path, pid)
    warden = if vouched?, do: disarm(warden, nil, @timeout_ms, {role, :ended}), else: warden
    Records.put_unattended(robot, path, pid)
    update_monitors(warden)
  end

  defp handle_end(warden, :topology, _pid) do
    warden = handle_dead_topology(warden)
    put_record(warden, %{warden.record | topology: nil})
  end

  defp handle_end(warden, :root, _pid) do
    warden = disarm(warden, nil, @timeout_ms, {:root, :ended})
    put_record(warden, %{warden.record | root: nil})
  end

  # With the root, the topology dies too: that is the end of the root.
  defp handle_dead_topology(%{record: %{root: root, topology: topology}} = warden) do
    cond do
      topology == nil or Process.alive?(topology) ->
        warden

      root != nil and Process.alive?(root) ->
        disarm(warden, nil, @timeout_ms, {:topology, :ended})

      true ->
        disarm(warden, nil, @timeout_ms, {:root, :ended})
    end
  end

  # Disarming

  defp disarm(%{record: %{state: :armed} = record} = warden, ref, timeout_ms, cause) do
    round = Round.new(record.robot, timeout_ms, cause)
    disarming = Record.disarming(record, ref, round)
    Records.put(disarming)
    warden = run(%{warden | record: disarming})
    Events.transition(record, disarming)
    Events.disarm_started(record.robot, round)
    finish_if_done(warden)
  end

  defp disarm(warden, _ref, _timeout_ms, _cause), do: warden

  defp run(%{record: %{round: nil}} = warden), do: warden

  defp run(%{record: %{round: round, robot: robot}} = warden) do
    deadline = :erlang.start_timer(round.deadline_ms, self(), :deadline, abs: true)
    %{warden | runs: Round.continue(round, robot), deadline: deadline}
  end

  defp finish_if_done(%{runs: runs, record: %{state: :disarming}} = warden) when runs == %{},
    do: finish(warden)

  defp finish_if_done(warden), do: warden

  defp finish(%{record: %{robot: robot, round: round}} = warden) do
    for {ref, _key} <- warden.runs, do: Process.demonitor(ref, [:flush])
    _ = :erlang.cancel_timer(warden.deadline)
    failures = Round.close(round, robot)

    warden =
      put_record(%{warden | runs: %{}, deadline: nil}, Record.disarmed(warden.record, failures))

    Records.clear_runs(robot, nil)
    Events.disarm_stopped(robot, round, failures)
    for from <- warden.waiting, do: GenServer.reply(from, Record.outcome(warden.record))
    %{warden | waiting: []}
  end

  defp wait(warden, from), do: %{warden | waiting: [from | warden.waiting]}

  # State

  defp put_record(%{record: old} = warden, record) do
    Records.put(record)
    if old.state != record.state, do: Events.transition(old, record)
    update_monitors(%{warden | record: record})
  end

  # Returns. A robot that has ended and is disarmed needs no warden.

  defp noreply(warden) do
    if over?(warden), do: {:stop, :normal, warden}, else: {:noreply, warden}
  end

  defp reply(warden, answer) do
    if over?(warden), do: {:stop, :normal, answer, warden}, else: {:reply, answer, warden}
  end

  defp over?(%{record: record}) do
    over? = Record.over?(record)
    if over?, do: Records.delete(record.robot)
    over?
  end
end

defmodule BB.Parameter.Persistence do
  @moduledoc """
  Queues a robot's parameters for its store, and replies to the callers of `BB.Parameter.set/3`.
  It writes no file itself. One call of the store saves all values that wait.

  Values that the store does not save are tried again: with the next value, and by a timer. Until
  then the alarm `{BB.Parameter, robot, :not_kept}` is set. The robot's table has the unsaved
  values too, so that they outlive this process.
  """
  @moduledoc no_example: "internal: BB.Parameter is its interface"

  use GenServer
  use BB.Process.Tolerant

  require Logger

  alias BB.Parameter.{Alarm, Reason, Values}
  alias BB.Parameter.Store.Session

  # The next call saves the rest.
  @most_requests 1_000

  @retry_ms 500
  @longest_retry_ms 5_000
  # A store that does not return delays callers for seconds.
  @longest_hang_retry_ms 30_000

  # Time for a callback to return, and then for the store to close.
  @shutdown_ms 20_000

  @enforce_keys [:robot, :module, :opts, :backlog]
  defstruct [
    :robot,
    :module,
    :opts,
    :backlog,
    :session,
    :failure,
    :timer,
    damage_checked?: false,
    hung?: false,
    retry_ms: @retry_ms
  ]

  @doc "Returns the child specification for `BB.Parameter.Supervisor`."
  @spec child_spec(module()) :: Supervisor.child_spec()
  def child_spec(robot),
    do: %{id: __MODULE__, start: {__MODULE__, :start_link, [robot]}, shutdown: @shutdown_ms}

  @doc "Opens the store that the robot declares. Returns `:ignore` when it declares none."
  @spec start_link(module()) :: GenServer.on_start()
  def start_link(robot) do
    case robot.robot().settings[:parameter_store] do
      nil -> :ignore
      {module, opts} -> start_link(robot, module, opts)
      module -> start_link(robot, module, [])
    end
  end

  defp start_link(robot, module, opts),
    do: GenServer.start_link(__MODULE__, {robot, module, opts}, name: name(robot))

  @doc "Returns the process of a robot, `nil` when the robot has no store."
  @spec whereis(module()) :: pid() | nil
  def whereis(robot), do: Process.whereis(name(robot))

  defp name(robot), do: Module.concat(robot, ParameterPersistence)

  @doc """
  Saves values that are unsaved in the table, by their `id`. `from` receives `:ok` or
  `{:error, {:not_kept, reason}}`.
  """
  @spec save(pid(), GenServer.from(), Values.id(), Session.values()) :: :ok
  def save(persistence, from, id, values) do
    send(persistence, {:keep, from, id, values})
    :ok
  end

  @impl GenServer
  def init({robot, module, opts}) do
    # terminate/2 closes the store, and the process of a store may die.
    Process.flag(:trap_exit, true)
    # A predecessor that was killed has not cleared them.
    Enum.each([:not_kept, :damaged], &Alarm.clear(alarm(robot, &1)))
    state = %__MODULE__{robot: robot, module: module, opts: opts, backlog: Values.unkept(robot)}
    {:ok, state |> open() |> save_backlog() |> update_alarm()}
  end

  @impl GenServer
  def handle_info({:keep, _from, _id, _values} = request, state),
    do: {:noreply, serve([request | take_waiting(@most_requests - 1)], state)}

  def handle_info(:retry, state) do
    state = %{state | timer: nil, hung?: false}
    {:noreply, state |> open() |> save_backlog() |> update_alarm()}
  end

  def handle_info({:EXIT, worker, reason}, %{session: %{worker: worker}} = state),
    do: {:noreply, state |> fail(:gone, "use", {:exit, reason}) |> update_alarm()}

  @impl GenServer
  def terminate(_reason, state) do
    # Does not wait for a store that is not open.
    _ = if state.session, do: close(serve(take_waiting(:infinity), state))
    Enum.each([:not_kept, :damaged], &Alarm.clear(alarm(state.robot, &1)))
  end

  # Requests

  defp take_waiting(0), do: []

  defp take_waiting(most) do
    receive do
      {:keep, _from, _id, _values} = request -> [request | take_waiting(decrement(most))]
    after
      0 -> []
    end
  end

  defp decrement(:infinity), do: :infinity
  defp decrement(most), do: most - 1

  defp serve(requests, state) do
    backlog = Enum.reduce(requests, state.backlog, &add/2)
    state = %{state | backlog: backlog} |> open_unless_hung() |> save_backlog() |> update_alarm()
    for {:keep, from, _id, values} <- requests, do: GenServer.reply(from, reply(state, values))
    state
  end

  # The later of two values for a path counts, also for the caller that set the earlier one.
  defp add({:keep, _from, id, values}, backlog),
    do: Enum.into(values, backlog, fn {path, value} -> {path, {id, value}} end)

  defp reply(state, values) do
    if Enum.any?(Map.keys(values), &is_map_key(state.backlog, &1)),
      do: {:error, {:not_kept, state.failure}},
      else: :ok
  end

  # The store

  defp open_unless_hung(%{hung?: true} = state), do: state
  defp open_unless_hung(state), do: open(state)

  defp open(%{session: nil} = state) do
    case Session.open(state.robot, state.module, state.opts) do
      {:ok, session, values} ->
        Values.put_kept(state.robot, values)
        check_damage(%{state | session: session})

      {kind, verb, reason} ->
        fail(state, kind, verb, reason)
    end
  end

  defp open(state), do: state

  # Once: a store whose process dies in damage/1 can still save values.
  defp check_damage(%{damage_checked?: true} = state), do: state

  defp check_damage(state) do
    state = %{state | damage_checked?: true}

    case Session.damage(state.session) do
      {:ok, nil} -> state
      {:ok, damage} -> report_damage(state, damage)
      {:error, _reason} -> state
      {:gone, _reason} -> open(%{state | session: nil})
    end
  end

  defp report_damage(state, damage) do
    Alarm.set(alarm(state.robot, :damaged), damage)
    state
  end

  defp save_backlog(%{backlog: backlog} = state) when backlog == %{}, do: state
  defp save_backlog(%{session: nil} = state), do: state

  defp save_backlog(state) do
    if Session.atomic?(state.session),
      do: save_as_one(state),
      else: Enum.reduce(state.backlog, state, &save_unit([&1], &2))
  end

  # When all values cannot be saved, some may: one value may be too large for the free space.
  defp save_as_one(state) do
    all = Map.to_list(state.backlog)
    state = save_unit(all, state)
    sets = all |> Enum.group_by(fn {_path, {id, _value}} -> id end) |> Map.values()
    if state.backlog == %{} or length(sets) == 1, do: state, else: save_each(sets, state)
  end

  defp save_each(sets, state), do: Enum.reduce(sets, state, &save_unit/2)

  defp save_unit(_unit, %{session: nil} = state), do: state

  defp save_unit(unit, state) do
    case save_values(state.session, for({path, {_id, value}} <- unit, do: {path, value})) do
      {:ok, :ok} -> mark_saved(state, unit)
      {kind, reason} -> fail(state, kind, "save #{paths(unit)} in", reason)
    end
  end

  defp save_values(session, values) do
    if Session.atomic?(session) do
      Session.save_many(session, values)
    else
      [{path, value}] = values
      Session.save(session, path, value)
    end
  end

  defp mark_saved(state, unit) do
    Values.put_kept(state.robot, for({path, {_id, value}} <- unit, do: {path, value}))
    Values.delete_unkept(state.robot, unit)
    %{state | backlog: Map.drop(state.backlog, for({path, _} <- unit, do: path))}
  end

  defp close(%{session: nil}), do: :ok

  defp close(state) do
    with {_kind, reason} when reason != :ok <- Session.close(state.session),
         do: warn(state, "close", reason)
  end

  # Failures

  defp fail(state, kind, verb, reason) do
    unless reason == state.failure, do: warn(state, verb, reason)
    state = %{state | failure: reason, hung?: match?({:timeout, _}, reason)}
    if kind == :gone, do: %{state | session: nil}, else: state
  end

  defp update_alarm(%{session: %{}, backlog: backlog} = state) when backlog == %{} do
    if state.failure, do: Logger.info("#{title(state)} saves values again")
    Alarm.clear(alarm(state.robot, :not_kept))
    _ = if state.timer, do: Process.cancel_timer(state.timer)
    %{state | failure: nil, timer: nil, retry_ms: @retry_ms}
  end

  defp update_alarm(state) do
    description = %{
      store: state.module,
      reason: state.failure,
      description: Reason.format(state.failure)
    }

    Alarm.set(alarm(state.robot, :not_kept), description)
    if state.timer, do: state, else: retry_later(state)
  end

  defp retry_later(state) do
    longest = if state.hung?, do: @longest_hang_retry_ms, else: @longest_retry_ms
    timer = Process.send_after(self(), :retry, state.retry_ms)
    %{state | timer: timer, retry_ms: min(2 * state.retry_ms, longest)}
  end

  defp alarm(robot, kind), do: {BB.Parameter, robot, kind}

  defp warn(state, verb, reason) do
    Logger.warning(
      "#{inspect(state.robot)}: cannot #{verb} the parameter store #{inspect(state.module)}: " <>
        Reason.format(reason)
    )
  end

  defp title(state), do: "#{inspect(state.robot)}: the parameter store #{inspect(state.module)}"

  defp paths([{path, _value}]), do: inspect(path)
  defp paths(unit), do: "#{length(unit)} values"
end

defmodule BB.Parameter.Persistence do
  @moduledoc """
  Has a robot's store keep what is set, and answers those who set it. What waits is saved
  together, by one call of the store.

  What the store does not take is tried again: with the next value, and after a while. Until then
  the alarm `{BB.Parameter, robot, :not_kept}` is set. What has not been kept is in the robot's
  table too, so that it outlives this process.
  """

  use GenServer
  use BB.Process.Tolerant

  require Logger

  alias BB.Parameter.{Alarm, Reason, Values}
  alias BB.Parameter.Store.Session

  # More are saved by the next call.
  @most_requests 1_000

  @retry_ms 500
  @longest_retry_ms 5_000
  # A store that does not return holds up for seconds those who set.
  @longest_hang_retry_ms 30_000

  # It may have to wait for a callback, and then for the store to be closed.
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
    asked?: false,
    hung?: false,
    retry_ms: @retry_ms
  ]

  @doc "Its place under the robot's runtime."
  @spec child_spec(module()) :: Supervisor.child_spec()
  def child_spec(robot),
    do: %{id: __MODULE__, start: {__MODULE__, :start_link, [robot]}, shutdown: @shutdown_ms}

  @doc "Opens the store that the robot declares; `:ignore` when it declares none."
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

  @doc "The process of a robot, `nil` when the robot has no store."
  @spec whereis(module()) :: pid() | nil
  def whereis(robot), do: Process.whereis(name(robot))

  defp name(robot), do: Module.concat(robot, ParameterPersistence)

  @doc """
  Has values kept that are unkept in the table, by their `id`. `from` gets `:ok` or `{:error,
  {:not_kept, reason}}`.
  """
  @spec keep(pid(), GenServer.from(), Values.id(), Session.values()) :: :ok
  def keep(persistence, from, id, values) do
    send(persistence, {:keep, from, id, values})
    :ok
  end

  @impl GenServer
  def init({robot, module, opts}) do
    # The store is closed in terminate/2, and a store's process may die.
    Process.flag(:trap_exit, true)
    # A predecessor that was killed has not cleared them.
    Enum.each([:not_kept, :damaged], &Alarm.clear(alarm(robot, &1)))
    state = %__MODULE__{robot: robot, module: module, opts: opts, backlog: Values.unkept(robot)}
    {:ok, state |> open() |> save_backlog() |> settle()}
  end

  @impl GenServer
  def handle_info({:keep, _from, _id, _values} = request, state),
    do: {:noreply, serve([request | waiting(@most_requests - 1)], state)}

  def handle_info(:retry, state) do
    state = %{state | timer: nil, hung?: false}
    {:noreply, state |> open() |> save_backlog() |> settle()}
  end

  def handle_info({:EXIT, worker, reason}, %{session: %{worker: worker}} = state),
    do: {:noreply, state |> fail(:gone, "use", {:exit, reason}) |> settle()}

  @impl GenServer
  def terminate(_reason, state) do
    # A store that is not open is not waited for.
    _ = if state.session, do: close(serve(waiting(:infinity), state))
    Enum.each([:not_kept, :damaged], &Alarm.clear(alarm(state.robot, &1)))
  end

  # Requests

  defp waiting(0), do: []

  defp waiting(most) do
    receive do
      {:keep, _from, _id, _values} = request -> [request | waiting(one_less(most))]
    after
      0 -> []
    end
  end

  defp one_less(:infinity), do: :infinity
  defp one_less(most), do: most - 1

  defp serve(requests, state) do
    backlog = Enum.reduce(requests, state.backlog, &add/2)
    state = %{state | backlog: backlog} |> open_unless_hung() |> save_backlog() |> settle()
    for {:keep, from, _id, values} <- requests, do: GenServer.reply(from, answer(state, values))
    state
  end

  # Of two values for a path the later counts, also for who set the earlier.
  defp add({:keep, _from, id, values}, backlog),
    do: Enum.into(values, backlog, fn {path, value} -> {path, {id, value}} end)

  defp answer(state, values) do
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
        ask_for_damage(%{state | session: session})

      {kind, verb, reason} ->
        fail(state, kind, verb, reason)
    end
  end

  defp open(state), do: state

  # Once: a store that dies of the question is good for values all the same.
  defp ask_for_damage(%{asked?: true} = state), do: state

  defp ask_for_damage(state) do
    state = %{state | asked?: true}

    case Session.damage(state.session) do
      {:ok, nil} -> state
      {:ok, damage} -> tell_damage(state, damage)
      {:error, _reason} -> state
      {:gone, _reason} -> open(%{state | session: nil})
    end
  end

  defp tell_damage(state, damage) do
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

  # Where all cannot be stored, some may: one value may be too large for what room there is.
  defp save_as_one(state) do
    all = Map.to_list(state.backlog)
    state = save_unit(all, state)
    sets = all |> Enum.group_by(fn {_path, {id, _value}} -> id end) |> Map.values()
    if state.backlog == %{} or length(sets) == 1, do: state, else: save_each(sets, state)
  end

  defp save_each(sets, state), do: Enum.reduce(sets, state, &save_unit/2)

  defp save_unit(_unit, %{session: nil} = state), do: state

  defp save_unit(unit, state) do
    case save(state.session, for({path, {_id, value}} <- unit, do: {path, value})) do
      {:ok, :ok} -> kept(state, unit)
      {kind, reason} -> fail(state, kind, "save #{paths(unit)} in", reason)
    end
  end

  defp save(session, values) do
    if Session.atomic?(session) do
      Session.save_many(session, values)
    else
      [{path, value}] = values
      Session.save(session, path, value)
    end
  end

  defp kept(state, unit) do
    Values.put_kept(state.robot, for({path, {_id, value}} <- unit, do: {path, value}))
    Values.delete_unkept(state.robot, unit)
    %{state | backlog: Map.drop(state.backlog, for({path, _} <- unit, do: path))}
  end

  defp close(%{session: nil}), do: :ok

  defp close(state) do
    with {_kind, reason} when reason != :ok <- Session.close(state.session),
         do: warn(state, "close", reason)
  end

  # How it goes

  defp fail(state, kind, verb, reason) do
    unless reason == state.failure, do: warn(state, verb, reason)
    state = %{state | failure: reason, hung?: match?({:timeout, _}, reason)}
    if kind == :gone, do: %{state | session: nil}, else: state
  end

  defp settle(%{session: %{}, backlog: backlog} = state) when backlog == %{} do
    if state.failure, do: Logger.info("#{title(state)} keeps values again")
    Alarm.clear(alarm(state.robot, :not_kept))
    _ = if state.timer, do: Process.cancel_timer(state.timer)
    %{state | failure: nil, timer: nil, retry_ms: @retry_ms}
  end

  defp settle(state) do
    description = %{
      store: state.module,
      reason: state.failure,
      description: Reason.words(state.failure)
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
        Reason.words(reason)
    )
  end

  defp title(state), do: "#{inspect(state.robot)}: the parameter store #{inspect(state.module)}"

  defp paths([{path, _value}]), do: inspect(path)
  defp paths(unit), do: "#{length(unit)} values"
end

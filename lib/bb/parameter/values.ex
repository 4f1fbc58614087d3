defmodule BB.Parameter.Values do
  @moduledoc """
  Where a robot's parameters are: an ETS table that anyone reads. `BB.Parameter.Owner` writes it,
  and `BB.Parameter.Persistence` what of it the store has.

  The process here owns the table and does nothing else, so that the values outlive a crash of the
  writer.
  """

  use GenServer
  use BB.Process.Tolerant

  alias BB.Parameter.Definition

  @typedoc "What tells the values of one request from those of the next."
  @type id :: reference()

  @type watch :: {reference(), pid(), [BB.Parameter.path()]}

  @doc "The name of a robot's table, and of the process that owns it."
  @spec name(module()) :: module()
  def name(robot) do
    # To make a name takes longer than to read a value.
    with nil <- :persistent_term.get({__MODULE__, robot}, nil), do: make_name(robot)
  end

  defp make_name(robot), do: Module.concat(robot, Parameters)

  @doc false
  def start_link(robot), do: GenServer.start_link(__MODULE__, robot, name: name(robot))

  @impl GenServer
  def init(robot) do
    :persistent_term.put({__MODULE__, robot}, make_name(robot))
    {:ok, :ets.new(name(robot), [:named_table, :public, read_concurrency: true])}
  end

  @doc """
  A parameter's value: `{:ok, value}` or `:error`. Raises `ArgumentError` when the robot is not
  started.
  """
  @spec fetch(module(), BB.Parameter.path()) :: {:ok, term()} | :error
  def fetch(robot, path) do
    case lookup(robot, {:value, path}) do
      [{_key, value}] -> {:ok, value}
      [] -> :error
    end
  end

  @doc "A parameter's definition: `{:ok, definition}` or `:error`."
  @spec fetch_definition(module(), BB.Parameter.path()) :: {:ok, Definition.t()} | :error
  def fetch_definition(robot, path) do
    case lookup(robot, {:definition, path}) do
      [{_key, definition}] -> {:ok, definition}
      [] -> :error
    end
  end

  @doc "All definitions, in the order of their paths."
  @spec definitions(module()) :: [Definition.t()]
  def definitions(robot),
    do: robot |> select({{:definition, :_}, :"$1"}) |> Enum.sort_by(& &1.path)

  @doc "Who is to hear of changes of which parameters."
  @spec watches(module()) :: [watch()]
  def watches(robot), do: select(robot, {{:watch, :_}, :"$1"})

  @doc "Sets values, all at the same moment."
  @spec put_values(module(), Enumerable.t()) :: :ok
  def put_values(robot, values),
    do: insert(robot, for({path, value} <- values, do: {{:value, path}, value}))

  @doc "Sets values that the store is to keep, all at the same moment."
  @spec put_unkept(module(), id(), %{BB.Parameter.path() => term()}) :: :ok
  def put_unkept(robot, id, values) do
    unkept = for {path, value} <- values, do: {{:unkept, path}, {path, {id, value}}}
    insert(robot, unkept ++ for({path, value} <- values, do: {{:value, path}, value}))
  end

  @doc "The values that the store has not kept."
  @spec unkept(module()) :: %{BB.Parameter.path() => {id(), term()}}
  def unkept(robot), do: robot |> select({{:unkept, :_}, :"$1"}) |> Map.new()

  @doc "Removes values that the store has kept, but not newer ones."
  @spec delete_unkept(module(), [{BB.Parameter.path(), {id(), term()}}]) :: :ok
  def delete_unkept(robot, kept) do
    if_there(:ok, fn ->
      for {path, _} = row <- kept, do: :ets.delete_object(name(robot), {{:unkept, path}, row})
      :ok
    end)
  end

  @doc "Notes what the store has."
  @spec put_kept(module(), Enumerable.t()) :: :ok
  def put_kept(robot, values) do
    rows = for {path, value} <- values, do: {{:kept, path}, value}
    if_there(:ok, fn -> insert(robot, rows) end)
  end

  @doc "The value of a path that the store has, or is to have: `{:ok, value}` or `:error`."
  @spec fetch_stored(module(), BB.Parameter.path()) :: {:ok, term()} | :error
  def fetch_stored(robot, path) do
    case {lookup(robot, {:unkept, path}), lookup(robot, {:kept, path})} do
      {[{_key, {^path, {_id, value}}}], _kept} -> {:ok, value}
      {[], [{_key, value}]} -> {:ok, value}
      {[], []} -> :error
    end
  end

  @doc "Notes that an alarm is set. Returns whether it was not."
  @spec put_alarm(module(), atom()) :: boolean()
  def put_alarm(robot, alarm),
    do: if_there(true, fn -> :ets.insert_new(name(robot), {{:alarm, alarm}, true}) end)

  @doc "Notes that an alarm is not set any more. Returns whether it was."
  @spec delete_alarm(module(), atom()) :: boolean()
  def delete_alarm(robot, alarm),
    do: if_there(true, fn -> :ets.take(name(robot), {:alarm, alarm}) != [] end)

  @doc "Adds or replaces definitions."
  @spec put_definitions(module(), [Definition.t()]) :: :ok
  def put_definitions(robot, definitions),
    do: insert(robot, for(each <- definitions, do: {{:definition, each.path}, each}))

  @doc "Removes a parameter."
  @spec delete(module(), BB.Parameter.path()) :: :ok
  def delete(robot, path) do
    :ets.delete(name(robot), {:definition, path})
    :ets.delete(name(robot), {:value, path})
    :ok
  end

  @doc "Adds a watch."
  @spec put_watch(module(), watch()) :: :ok
  def put_watch(robot, {ref, _pid, _paths} = watch), do: insert(robot, [{{:watch, ref}, watch}])

  @doc "Removes a watch."
  @spec delete_watch(module(), reference()) :: :ok
  def delete_watch(robot, ref) do
    if_there(:ok, fn ->
      :ets.delete(name(robot), {:watch, ref})
      :ok
    end)
  end

  # The table may be gone, and what was to be done with it.
  defp if_there(otherwise, fun) do
    fun.()
  rescue
    ArgumentError -> otherwise
  end

  defp insert(robot, rows) do
    :ets.insert(name(robot), rows)
    :ok
  end

  defp lookup(robot, key) do
    :ets.lookup(name(robot), key)
  rescue
    ArgumentError -> not_started!(robot)
  end

  defp select(robot, pattern) do
    :ets.select(name(robot), [{pattern, [], [:"$1"]}])
  rescue
    ArgumentError -> not_started!(robot)
  end

  @doc false
  @spec not_started!(term()) :: no_return()
  def not_started!(robot) do
    raise ArgumentError,
          "the robot #{inspect(robot)} is not started: start it under a supervisor or with #{inspect(robot)}.start_link() first"
  end
end

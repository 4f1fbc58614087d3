defmodule BB.Parameter.Values do
  @moduledoc """
  The parameters of a robot in an ETS table, which any process reads. `BB.Parameter.Owner`
  writes the values, `BB.Parameter.Persistence` the saved values.

  This process owns the table and does nothing else, so that the values outlive a crash of the
  writers.
  """
  @moduledoc no_example: "internal: BB.Parameter is its interface"

  use GenServer
  use BB.Process.Tolerant

  alias BB.Parameter.Definition

  @typedoc """
  The id of a request, which distinguishes its values from the values of later requests.
  """
  @type id :: reference()

  @type watch :: {reference(), pid(), [BB.Parameter.path()]}

  @doc "Returns the name of a robot's table, which is also the name of its owner."
  @spec name(module()) :: module()
  def name(robot) do
    # Making the name takes longer than reading a value.
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
  Fetches a parameter's value: `{:ok, value}` or `:error`. Raises `ArgumentError` when the robot
  is not started.
  """
  @spec fetch(module(), BB.Parameter.path()) :: {:ok, term()} | :error
  def fetch(robot, path) do
    case lookup(robot, {:value, path}) do
      [{_key, value}] -> {:ok, value}
      [] -> :error
    end
  end

  @doc "Fetches a parameter's definition: `{:ok, definition}` or `:error`."
  @spec fetch_definition(module(), BB.Parameter.path()) :: {:ok, Definition.t()} | :error
  def fetch_definition(robot, path) do
    case lookup(robot, {:definition, path}) do
      [{_key, definition}] -> {:ok, definition}
      [] -> :error
    end
  end

  @doc "Returns all definitions, in the order of their paths."
  @spec definitions(module()) :: [Definition.t()]
  def definitions(robot),
    do: robot |> select({{:definition, :_}, :"$1"}) |> Enum.sort_by(& &1.path)

  @doc "Returns all watches."
  @spec watches(module()) :: [watch()]
  def watches(robot), do: select(robot, {{:watch, :_}, :"$1"})

  @doc "Stores values, all at the same moment."
  @spec put_values(module(), Enumerable.t()) :: :ok
  def put_values(robot, values),
    do: insert(robot, for({path, value} <- values, do: {{:value, path}, value}))

  @doc "Stores values that the store has not saved yet, all at the same moment."
  @spec put_unkept(module(), id(), %{BB.Parameter.path() => term()}) :: :ok
  def put_unkept(robot, id, values) do
    unkept = for {path, value} <- values, do: {{:unkept, path}, {path, {id, value}}}
    insert(robot, unkept ++ for({path, value} <- values, do: {{:value, path}, value}))
  end

  @doc "Returns the values that the store has not saved yet."
  @spec unkept(module()) :: %{BB.Parameter.path() => {id(), term()}}
  def unkept(robot), do: robot |> select({{:unkept, :_}, :"$1"}) |> Map.new()

  @doc "Marks values as saved, unless newer values have replaced them."
  @spec delete_unkept(module(), [{BB.Parameter.path(), {id(), term()}}]) :: :ok
  def delete_unkept(robot, kept) do
    unless_gone(:ok, fn ->
      for {path, _} = row <- kept, do: :ets.delete_object(name(robot), {{:unkept, path}, row})
      :ok
    end)
  end

  @doc "Stores the values that the store has saved."
  @spec put_kept(module(), Enumerable.t()) :: :ok
  def put_kept(robot, values) do
    rows = for {path, value} <- values, do: {{:kept, path}, value}
    unless_gone(:ok, fn -> insert(robot, rows) end)
  end

  @doc "Fetches the value of a path that the store has or will have: `{:ok, value}` or `:error`."
  @spec fetch_stored(module(), BB.Parameter.path()) :: {:ok, term()} | :error
  def fetch_stored(robot, path) do
    case {lookup(robot, {:unkept, path}), lookup(robot, {:kept, path})} do
      {[{_key, {^path, {_id, value}}}], _kept} -> {:ok, value}
      {[], [{_key, value}]} -> {:ok, value}
      {[], []} -> :error
    end
  end

  @doc "Marks an alarm as set. Returns `true` if it was not set."
  @spec put_alarm(module(), atom()) :: boolean()
  def put_alarm(robot, alarm),
    do: unless_gone(true, fn -> :ets.insert_new(name(robot), {{:alarm, alarm}, true}) end)

  @doc "Marks an alarm as cleared. Returns `true` if it was set."
  @spec delete_alarm(module(), atom()) :: boolean()
  def delete_alarm(robot, alarm),
    do: unless_gone(true, fn -> :ets.take(name(robot), {:alarm, alarm}) != [] end)

  @doc "Adds or replaces definitions."
  @spec put_definitions(module(), [Definition.t()]) :: :ok
  def put_definitions(robot, definitions),
    do: insert(robot, for(each <- definitions, do: {{:definition, each.path}, each}))

  @doc "Removes the value of a parameter."
  @spec delete_value(module(), BB.Parameter.path()) :: :ok
  def delete_value(robot, path) do
    :ets.delete(name(robot), {:value, path})
    :ok
  end

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
    unless_gone(:ok, fn ->
      :ets.delete(name(robot), {:watch, ref})
      :ok
    end)
  end

  # The table may have been deleted, and its rows with it.
  defp unless_gone(otherwise, fun) do
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
          "robot #{inspect(robot)} is not started; start it under a supervisor or with " <>
            "#{inspect(robot)}.start_link()"
  end
end

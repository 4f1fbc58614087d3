defmodule BB.Parameter.Table do
  @moduledoc """
  Where a robot's parameters are: an ETS table that anyone reads and only `BB.Parameter.Owner` writes.

  The process here owns the table and does nothing else, so that the values outlive a crash of the writer.
  """

  use GenServer

  alias BB.Parameter.Definition

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

  @doc "A parameter's value: `{:ok, value}` or `:error`. Raises `ArgumentError` when the robot is not started."
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
    :ets.delete(name(robot), {:watch, ref})
    :ok
  rescue
    # The table is gone, and the watch with it.
    ArgumentError -> :ok
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

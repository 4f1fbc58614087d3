defmodule BB.Command.Executions do
  @moduledoc """
  The operational state of a robot and its executions, in an ETS table. A reader waits for no
  process; `BB.Command.Dispatcher` alone writes.

  `BB.Command.Supervisor` owns the table, so that the operational state outlives a crash of the
  dispatcher. The operational state belongs to an arming: after the next one it is the robot's
  initial state.
  """
  @moduledoc no_example: "internal: BB.Robot.Runtime is its interface"

  alias BB.Command.Admission
  alias BB.Dsl.Info
  alias BB.Parameter.Values
  alias BB.Safety.{Records, Route}

  @typedoc "An execution, as `BB.Robot.Runtime.executing_commands/1` returns it."
  @type execution :: %{
          name: atom(),
          execution_id: reference(),
          pid: pid(),
          category: atom(),
          started_at: DateTime.t()
        }

  @doc "Creates the table of a robot. It belongs to the calling process."
  @spec create(module()) :: :ok
  def create(robot) do
    table = :ets.new(Route.name(robot), [:named_table, :public, read_concurrency: true])
    :ets.insert(table, {:initial, Info.initial_state(robot)})
    :ets.insert(table, {:limits, Info.category_limits(robot)})
    :ok
  end

  @doc "Removes all executions."
  @spec clear(module()) :: :ok
  def clear(robot) do
    :ets.match_delete(Route.name(robot), {{:execution, :_}, :_})
    :ok
  end

  @doc "Stores an execution."
  @spec put(module(), execution()) :: true
  def put(robot, execution),
    do: :ets.insert(Route.name(robot), {{:execution, execution.execution_id}, execution})

  @doc "Removes an execution."
  @spec delete(module(), reference()) :: true
  def delete(robot, id), do: :ets.delete(Route.name(robot), {:execution, id})

  @doc "Returns the executions, the oldest first."
  @spec list(module()) :: [execution()]
  def list(robot) do
    reading(robot, fn table ->
      table
      |> :ets.match({{:execution, :_}, :"$1"})
      |> Enum.map(&hd/1)
      |> Enum.sort_by(& &1.started_at, DateTime)
    end)
  end

  @doc "Returns the state of the robot and its executions, for `BB.Command.Admission`."
  @spec situation(module()) :: Admission.situation()
  def situation(robot) do
    %{
      safety: Records.state(robot),
      operational: operational(robot),
      running: for(it <- list(robot), do: %{id: it.execution_id, category: it.category}),
      limits: limits(robot)
    }
  end

  @doc "Returns how many commands of each category may run at the same time."
  @spec limits(module()) :: %{atom() => pos_integer()}
  def limits(robot), do: reading(robot, &:ets.lookup_element(&1, :limits, 2))

  @doc "Returns the operational state."
  @spec operational(module()) :: atom()
  def operational(robot) do
    reading(robot, fn table ->
      case :ets.lookup(table, :operational) do
        [{:operational, state, epoch}] -> if kept?(robot, epoch), do: state, else: initial(table)
        [] -> initial(table)
      end
    end)
  end

  defp initial(table), do: :ets.lookup_element(table, :initial, 2)

  defp kept?(robot, epoch), do: Records.state(robot) != :armed or epoch(robot) == epoch

  @doc "Stores the operational state of the present arming."
  @spec put_operational(module(), atom()) :: true
  def put_operational(robot, state),
    do: :ets.insert(Route.name(robot), {:operational, state, epoch(robot)})

  defp epoch(robot) do
    case Records.epoch(robot) do
      {:ok, epoch} -> epoch
      :error -> :none
    end
  end

  @doc """
  Returns the state of the robot: the safety state unless it is armed, else the operational state,
  but `:executing` while commands run in `:idle`.
  """
  @spec state(module()) :: atom()
  def state(robot) do
    case Records.state(robot) do
      :armed -> armed_state(robot, operational(robot))
      state -> state
    end
  end

  defp armed_state(robot, :idle), do: if(list(robot) == [], do: :idle, else: :executing)
  defp armed_state(_robot, operational), do: operational

  defp reading(robot, fun) do
    fun.(Route.name(robot))
  rescue
    ArgumentError -> Values.not_started!(robot)
  end
end

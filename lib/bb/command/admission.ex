defmodule BB.Command.Admission do
  @moduledoc """
  Decides whether a command may start, and which executions it preempts. Pure.
  `BB.Command.Dispatcher` asks it for each request.

      iex> alias BB.Command.Admission
      iex> wave = %BB.Dsl.Command{name: :wave, category: :arm, allowed_states: [:idle]}
      iex> situation = %{safety: :armed, operational: :idle, running: [], limits: %{arm: 1}}
      iex> Admission.decide(wave, situation)
      :start
      iex> Admission.decide(wave, %{situation | safety: :error})
      {:error, :safety_error}
  """

  alias BB.Dsl.Command
  alias BB.Error.{Category, State}

  # The limit of a category that a command names and the robot does not declare.
  @default_limit 1

  @typedoc "An execution, as far as a decision needs it."
  @type execution :: %{
          required(:id) => reference(),
          required(:category) => atom(),
          optional(atom()) => term()
        }

  @typedoc "The state of the robot and its executions."
  @type situation :: %{
          safety: BB.Safety.state(),
          operational: atom(),
          running: [execution()],
          limits: %{atom() => pos_integer()}
        }

  @doc """
  Decides about a command: to start it, to preempt executions first, or to refuse it.
  """
  @spec decide(Command.t(), situation()) ::
          :start | {:preempt, [reference(), ...]} | {:error, term()}
  def decide(%Command{} = command, situation) do
    with :ok <- check_allowed(command.name, command.allowed_states, situation) do
      case for(execution <- situation.running, preempts?(command, execution), do: execution.id) do
        [] -> check_room(command.category, situation)
        ids -> {:preempt, ids}
      end
    end
  end

  @doc """
  Checks that an operation is allowed in the state of the robot. The state `:*` stands for all,
  also for `:disarmed`.
  """
  @spec check_allowed(term(), [atom()], situation()) :: :ok | {:error, term()}
  def check_allowed(_operation, _states, %{safety: :error}), do: {:error, :safety_error}
  def check_allowed(_operation, _states, %{safety: :disarming}), do: {:error, :disarming}

  def check_allowed(operation, states, situation) do
    if Enum.any?(states, &(&1 == :* or &1 in present_states(situation))) do
      :ok
    else
      {:error,
       %State.NotAllowed{
         operation: operation,
         current_state: hd(present_states(situation)),
         allowed_states: states
       }}
    end
  end

  defp present_states(%{safety: :disarmed}), do: [:disarmed]

  defp present_states(%{operational: :idle, running: [_ | _]}), do: [:idle, :executing]
  defp present_states(%{operational: state}), do: [state]

  defp preempts?(%{cancel: categories}, execution),
    do: :* in categories or execution.category in categories

  defp check_room(category, situation) do
    running = Enum.count(situation.running, &(&1.category == category))
    limit = Map.get(situation.limits, category, @default_limit)

    if running < limit,
      do: :start,
      else: {:error, %Category.Full{category: category, limit: limit, current: running}}
  end
end

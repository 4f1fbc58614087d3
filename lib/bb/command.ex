defmodule BB.Command do
  @moduledoc """
  The behaviour of a command's handler, and the functions that wait for a command. A command is
  something that the robot does and finishes: wave, drive home, calibrate.

  Implement it for each thing that a person or a program can ask the robot to do. Each execution
  has a process of its own (`BB.Command.Server`), so a handler may take its time.

      defmodule MyRobot.Wave do
        use BB.Command

        @impl BB.Command
        def handle_command(%{times: times}, context, state) do
          send(self(), {:wave, times})
          {:noreply, Map.put(state, :robot, context.robot_module)}
        end

        @impl BB.Command
        def handle_info({:wave, 0}, state), do: {:stop, :normal, %{state | result: :waved}}

        def handle_info({:wave, times}, state) do
          :ok = BB.Actuator.set_position(state.robot, :arm, 0.5)
          Process.send_after(self(), {:wave, times - 1}, 500)
          {:noreply, state}
        end

        @impl BB.Command
        def result(%{result: nil}), do: {:error, :interrupted}
        def result(%{result: result}), do: {:ok, result}
      end

  A robot declares it:

      commands do
        command :arm do
          handler BB.Command.Arm
          allowed_states [:disarmed]
        end

        command :disarm do
          handler BB.Command.Disarm
          allowed_states [:idle]
        end

        command :wave do
          handler MyRobot.Wave
          timeout 10_000
          argument :times, :integer, default: 3
        end
      end

  and gets a function for each command, which starts an execution:

      {:ok, command} = MyRobot.wave(times: 2)
      {:ok, :waved} = BB.Command.await(command)

  ## An execution

  `c:init/1` receives the options of the handler as declared, checked against its schema and with
  the values of parameters, and

    * `opts[:bb]` - `%{robot: robot_module}`
    * `opts[:goal]` - the goal, a map (`BB.Robot.Runtime.coerce_goal/2`)
    * `opts[:context]` - a `BB.Command.Context`

  Then `c:handle_command/3` is called, and the further callbacks as in `GenServer`, until one of
  them returns `{:stop, reason, state}`. `c:result/1` returns the result from the last state. A
  command that is cancelled (`cancel/1`, or another command with its category in `cancel`), that
  exceeds its `timeout`, or whose robot is not armed any more, is stopped with the reason
  `{:shutdown, :cancelled}`, `{:shutdown, :timeout}` or `{:shutdown, :disarmed}`, and its result
  is taken from the state too. One that does not stop within 5 s is killed.

  The execution is published as `BB.Command.Event` on `[:command, name, execution_id]`.

  ## When a command may start

  A command may start in the states of its `allowed_states` (`BB.Robot.Runtime.state/1`), by
  default `[:idle]`; `:*` stands for all. It first cancels the executions whose category stands
  in its `cancel`. Then its own category must have room. `BB.Robot.Runtime.execute/3` lists the
  errors.
  """

  alias BB.Command.{Context, Dispatcher, Results}
  alias BB.Component.Callbacks

  @await_ms 5_000

  @type result :: Results.result()
  @type next :: timeout() | :hibernate | {:continue, term()}

  @type noreply ::
          {:noreply, new_state :: term()}
          | {:noreply, new_state :: term(), next()}
          | {:stop, reason :: term(), new_state :: term()}

  @doc "Returns the schema of the handler's options."
  @callback options_schema() :: BB.Options.schema() | BB.Options.t()

  @doc """
  Makes the state of an execution. By default it is a map of all options, with `result: nil` and
  `next_state: nil`.
  """
  @callback init(opts :: keyword()) :: {:ok, state :: term()} | {:stop, reason :: term()}

  @doc "Begins to execute the command."
  @callback handle_command(goal :: map(), Context.t(), state :: term()) :: noreply()

  @doc """
  Returns the result of an execution that ends with this state.

  `next_state:` becomes the robot's operational state.
  """
  @callback result(state :: term()) ::
              {:ok, term()} | {:ok, term(), [next_state: atom()]} | {:error, term()}

  @doc """
  Handles that the robot is not armed any more: its state is `:disarming`, `:disarmed` or
  `:error`. By default the execution stops, with the reason `{:shutdown, :disarmed}`.
  """
  @callback handle_safety_state_change(BB.Safety.state(), state :: term()) ::
              {:continue, new_state :: term()} | noreply()

  @doc """
  Applies new options after a parameter to which they refer has changed. By default the state does
  not change.
  """
  @callback handle_options(new_opts :: keyword(), state :: term()) ::
              {:ok, state :: term()} | {:stop, reason :: term()}

  @doc "Handles a call, as in `GenServer`. By default it replies `{:error, :not_implemented}`."
  @callback handle_call(request :: term(), GenServer.from(), state :: term()) ::
              {:reply, reply :: term(), new_state :: term()}
              | {:reply, reply :: term(), new_state :: term(), next()}
              | {:stop, reason :: term(), reply :: term(), new_state :: term()}
              | noreply()

  @doc "Handles a cast, as in `GenServer`. By default it ignores the request."
  @callback handle_cast(request :: term(), state :: term()) :: noreply()

  @doc "Handles a message, as in `GenServer`. By default it ignores the message."
  @callback handle_info(message :: term(), state :: term()) :: noreply()

  @doc "Continues after another callback, as in `GenServer`. By default it does nothing."
  @callback handle_continue(argument :: term(), state :: term()) :: noreply()

  @doc "Cleans up, as in `GenServer`. It is called after `c:result/1`."
  @callback terminate(reason :: term(), state :: term()) :: term()

  @doc false
  defmacro __using__(opts) do
    quote do
      unquote(Callbacks.code(__MODULE__, opts))

      @doc false
      def init(opts), do: {:ok, Map.merge(Map.new(opts), %{result: nil, next_state: nil})}

      @doc false
      def handle_safety_state_change(_state, state), do: {:stop, {:shutdown, :disarmed}, state}

      defoverridable init: 1, handle_safety_state_change: 2
    end
  end

  @doc """
  Waits for the result of an execution and returns it.

  It is that of `c:result/1`, or

    * `{:error, %BB.Error.State.CommandCrashed{}}` - the handler raised, or its process was killed
    * `{:error, %BB.Error.Invalid.CommandResult{}}` - `c:result/1` returned something else
    * `{:error, {:command_failed, :timeout}}` - there is no result after `timeout` milliseconds,
      and the command continues
    * `{:error, {:command_failed, reason}}` - the execution was stopped before it began, or there
      is no result any more

  A result is kept for 60 s after the execution has ended, and given once.
  """
  @spec await(pid(), timeout()) :: result()
  def await(pid, timeout \\ @await_ms) when is_pid(pid) do
    case Results.await(pid, timeout) do
      {:ok, result} -> result
      :timeout -> {:error, {:command_failed, :timeout}}
    end
  end

  @doc "Returns the result of an execution as `await/2` does, or `nil` when there is none yet."
  @spec yield(pid(), timeout()) :: result() | nil
  def yield(pid, timeout \\ 0) when is_pid(pid) do
    case Results.await(pid, timeout) do
      {:ok, result} -> result
      :timeout -> nil
    end
  end

  @doc """
  Cancels an execution, and returns at once: `:ok`, also for one that has ended.

  The execution is stopped with the reason `{:shutdown, :cancelled}`, and gives a result.
  """
  @spec cancel(pid()) :: :ok
  def cancel(pid) when is_pid(pid) do
    case Results.robot(pid) do
      {:ok, robot} -> Dispatcher.cancel(robot, pid)
      :error -> :ok
    end
  end

  @doc """
  Changes the operational state of the robot from an execution that is running.

  Errors: `:not_executing`, when the execution of the context has ended, and
  `%BB.Error.State.Invalid{}` for a state that the robot does not have.
  """
  @spec transition_state(Context.t(), atom()) :: :ok | {:error, term()}
  def transition_state(%Context{robot_module: robot, execution_id: id}, state),
    do: Dispatcher.transition(robot, state, id)
end

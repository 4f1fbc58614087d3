defmodule BB.Command.Dispatcher do
  @grace_ms 5_000

  @moduledoc """
  The process that starts the executions of a robot's commands, one request at a time, and knows
  when they end. `BB.Robot.Runtime` and `BB.Safety.Route` call it.

  `BB.Command.Admission` decides about each request. A request that preempts executions waits
  until they have ended, and is decided again then. An execution that is to stop, because it is
  cancelled or late, is killed when it has not ended after #{div(@grace_ms, 1_000)} s.
  The dispatcher calls no code of others, and waits for no execution.
  """
  @moduledoc no_example: "internal: BB.Robot.Runtime is its interface"

  use GenServer
  use BB.Process.Tolerant

  require Logger

  alias BB.{Message, PubSub}
  alias BB.Command.{Admission, Event, Executions, Goal, Results, Server}
  alias BB.Dsl.{Command, Info}
  alias BB.Error.State.{CommandCrashed, Invalid}
  alias BB.Parameter.Values
  alias BB.Safety.{Records, Route}
  alias BB.StateMachine.Transition

  @enforce_keys [:robot, :commands, :states, :flagged]
  defstruct [:robot, :commands, :states, :flagged, running: %{}, waiting: []]

  # A request: what to execute, and for whom. Safety gets the result, others the pid.
  # An execution: its command, pid, monitor and timer, and the callers of safety that wait for it.

  @type t :: %__MODULE__{
          robot: module(),
          commands: %{atom() => Command.t()},
          states: [atom()],
          flagged: %{arm: atom(), disarm: atom()},
          running: %{reference() => map()},
          waiting: [{[reference()], map()}]
        }

  @doc "Executes a command: `{:ok, pid}` or `{:error, reason}`."
  @spec execute(module(), atom(), map()) :: {:ok, pid()} | {:error, term()}
  def execute(robot, name, goal), do: call(robot, {:execute, name, goal})

  @doc "Changes the operational state. With `id` it is the execution `id` that changes it."
  @spec transition(module(), atom(), reference() | :any) :: :ok | {:error, term()}
  def transition(robot, state, id \\ :any), do: call(robot, {:transition, state, id})

  @doc "Cancels all executions."
  @spec cancel(module()) :: :ok | {:error, :no_execution}
  def cancel(robot), do: call(robot, :cancel)

  @doc "Cancels the execution of a process."
  @spec cancel(module(), pid()) :: :ok
  def cancel(robot, pid), do: GenServer.cast(Route.name(robot), {:cancel, pid})

  @doc "Reports the end of the execution `id`, whose process is the calling one."
  @spec finish(module(), reference(), Results.result()) :: :ok
  def finish(robot, id, result) do
    GenServer.call(Route.name(robot), {:finish, id, result}, @grace_ms)
  catch
    # The dispatcher has died, and with it what it knew of this execution.
    :exit, _reason -> :ok
  end

  defp call(robot, request) do
    GenServer.call(Route.name(robot), request, :infinity)
  catch
    :exit, {_reason, {GenServer, :call, _arguments}} ->
      if Process.whereis(robot), do: {:error, :unavailable}, else: Values.not_started!(robot)
  end

  @doc "Returns the name of the supervisor of the executions."
  @spec supervisor(module()) :: module()
  def supervisor(robot), do: Module.concat(robot, CommandSupervisor)

  @doc false
  @spec start_link(module()) :: GenServer.on_start()
  def start_link(robot), do: GenServer.start_link(__MODULE__, robot, name: Route.name(robot))

  @impl GenServer
  def init(robot) do
    Executions.clear(robot)

    {:ok, _bus} =
      PubSub.subscribe(robot, [:state_machine], message_types: [Transition], exact: true)

    {:ok,
     %__MODULE__{
       robot: robot,
       commands: for(%Command{} = it <- Info.commands(robot), into: %{}, do: {it.name, it}),
       states: Info.state_names(robot),
       flagged: %{arm: Info.arm_command(robot), disarm: Info.disarm_command(robot)}
     }}
  end

  # Requests

  @impl GenServer
  def handle_call({:execute, name, goal}, from, dispatcher),
    do: {:noreply, request(dispatcher, %{name: name, goal: goal, from: from, for: :anyone})}

  def handle_call({Route, flag}, {caller, _tag} = from, dispatcher) do
    name = dispatcher.flagged[flag]

    case Enum.find(dispatcher.running, fn {_id, it} -> it.command.name == name end) do
      {_id, %{pid: ^caller}} -> {:reply, :direct, dispatcher}
      {id, _execution} -> {:noreply, add_caller(dispatcher, id, from)}
      nil -> {:noreply, request(dispatcher, %{name: name, goal: %{}, from: from, for: :safety})}
    end
  end

  def handle_call({:transition, state, id}, _from, dispatcher) do
    cond do
      id != :any and not is_map_key(dispatcher.running, id) ->
        {:reply, {:error, :not_executing}, dispatcher}

      state not in dispatcher.states ->
        error = %Invalid{state: state, valid_states: dispatcher.states}
        {:reply, {:error, error}, dispatcher}

      true ->
        before = Executions.state(dispatcher.robot)
        Executions.put_operational(dispatcher.robot, state)
        {:reply, :ok, publish_transition(dispatcher, before)}
    end
  end

  def handle_call(:cancel, _from, %{running: none} = dispatcher) when none == %{},
    do: {:reply, {:error, :no_execution}, dispatcher}

  def handle_call(:cancel, _from, dispatcher),
    do: {:reply, :ok, stop(dispatcher, Map.keys(dispatcher.running), :cancelled)}

  def handle_call({:finish, id, result}, _from, dispatcher),
    do: {:reply, :ok, finish_execution(dispatcher, id, result)}

  @impl GenServer
  def handle_cast({:cancel, pid}, dispatcher) do
    ids = for {id, %{pid: ^pid}} <- dispatcher.running, do: id
    {:noreply, stop(dispatcher, ids, :cancelled)}
  end

  @impl GenServer
  def handle_info({:DOWN, _monitor, :process, pid, reason}, dispatcher) do
    case Enum.find(dispatcher.running, fn {_id, execution} -> execution.pid == pid end) do
      {id, %{command: command}} ->
        crash = %CommandCrashed{command: command.name, exception: reason}
        {:noreply, finish_execution(dispatcher, id, {:error, crash})}

      nil ->
        {:noreply, dispatcher}
    end
  end

  def handle_info({:timeout, timer, {event, id}}, dispatcher) do
    case dispatcher.running do
      %{^id => %{timer: ^timer} = execution} -> {:noreply, expire(dispatcher, event, execution)}
      _ended_or_stopped -> {:noreply, dispatcher}
    end
  end

  # An execution decides itself whether it goes on when the robot is not armed any more.
  def handle_info({:bb, [:state_machine], %Message{payload: %Transition{to: to}}}, dispatcher)
      when to in [:disarming, :disarmed, :error] do
    for {_id, %{pid: pid}} <- dispatcher.running, do: send(pid, {Server, :safety, to})
    {:noreply, dispatcher}
  end

  def handle_info(_message, dispatcher), do: {:noreply, dispatcher}

  # Starting

  defp request(dispatcher, request) do
    with {:ok, command} <- fetch_command(dispatcher, request.name),
         {:ok, goal} <- Goal.complete(request.goal, command),
         :start <- Admission.decide(command, Executions.situation(dispatcher.robot)) do
      start(dispatcher, request, command, goal)
    else
      {:preempt, ids} ->
        waiting = dispatcher.waiting ++ [{ids, request}]
        stop(%{dispatcher | waiting: waiting}, ids, :cancelled)

      {:error, reason} ->
        refuse(dispatcher, request, reason)
    end
  end

  defp fetch_command(%{commands: commands}, name) do
    with :error <- Map.fetch(commands, name), do: {:error, {:unknown_command, name}}
  end

  defp start(dispatcher, request, command, goal) do
    argument = %{
      robot: dispatcher.robot,
      command: command,
      goal: goal,
      id: make_ref(),
      armed?: Records.state(dispatcher.robot) == :armed
    }

    case start_server(argument) do
      {:ok, pid} -> run(dispatcher, request, argument, pid)
      {:error, reason} -> refuse(dispatcher, request, reason)
    end
  end

  defp start_server(argument) do
    DynamicSupervisor.start_child(supervisor(argument.robot), {Server, argument})
  catch
    # It is being restarted.
    :exit, _reason -> {:error, :unavailable}
  end

  # The execution begins when everyone can see it.
  defp run(%{robot: robot} = dispatcher, request, %{id: id, command: command, goal: goal}, pid) do
    before = Executions.state(robot)

    Executions.put(robot, %{
      name: command.name,
      execution_id: id,
      pid: pid,
      category: command.category,
      started_at: DateTime.utc_now()
    })

    execution = %{
      id: id,
      command: command,
      pid: pid,
      monitor: Process.monitor(pid),
      timer: start_timer(command.timeout, {:late, id}),
      callers: if(request.for == :safety, do: [request.from], else: [])
    }

    publish_event(robot, command.name, id, :started, %{goal: goal})
    dispatcher = publish_transition(dispatcher, before)
    Server.begin(pid)
    if request.for == :anyone, do: GenServer.reply(request.from, {:ok, pid})
    %{dispatcher | running: Map.put(dispatcher.running, id, execution)}
  end

  defp refuse(dispatcher, %{for: :safety} = request, reason) do
    GenServer.reply(request.from, {:done, {:error, reason}})
    dispatcher
  end

  defp refuse(dispatcher, request, reason) do
    GenServer.reply(request.from, {:error, reason})
    dispatcher
  end

  defp add_caller(dispatcher, id, from),
    do: update_in(dispatcher.running[id].callers, &[from | &1])

  # Ending

  defp stop(dispatcher, ids, reason) do
    Enum.reduce(ids, dispatcher, fn id, dispatcher ->
      case dispatcher.running do
        %{^id => %{stopping?: true}} -> dispatcher
        %{^id => execution} -> stop_execution(dispatcher, execution, reason)
        _ended -> dispatcher
      end
    end)
  end

  defp stop_execution(dispatcher, execution, reason) do
    Server.stop(execution.pid, {:shutdown, reason})
    cancel_timer(execution.timer)
    timer = start_timer(@grace_ms, {:overdue, execution.id})
    execution = Map.merge(execution, %{timer: timer, stopping?: true})
    %{dispatcher | running: Map.put(dispatcher.running, execution.id, execution)}
  end

  defp expire(dispatcher, :late, execution), do: stop_execution(dispatcher, execution, :timeout)

  defp expire(dispatcher, :overdue, execution) do
    Logger.warning(
      "#{inspect(dispatcher.robot)}: command #{inspect(execution.command.name)} was stopped " <>
        "and did not end within #{@grace_ms} ms; it is killed"
    )

    Process.exit(execution.pid, :kill)
    dispatcher
  end

  defp finish_execution(%{robot: robot} = dispatcher, id, result) do
    case Map.pop(dispatcher.running, id) do
      {nil, _running} ->
        dispatcher

      {execution, running} ->
        Process.demonitor(execution.monitor, [:flush])
        cancel_timer(execution.timer)
        before = Executions.state(robot)
        Executions.delete(robot, id)
        put_next_state(dispatcher, execution.command, result)
        publish_end(robot, execution.command.name, id, result)
        for from <- execution.callers, do: GenServer.reply(from, {:done, result})

        %{dispatcher | running: running}
        |> publish_transition(before)
        |> retry_waiting()
    end
  end

  defp put_next_state(dispatcher, command, {:ok, _value, options}) do
    case options[:next_state] do
      # A robot keeps its operational state while it is disarmed.
      state when state in [nil, :disarmed] ->
        :ok

      state ->
        if state in dispatcher.states,
          do: Executions.put_operational(dispatcher.robot, state),
          else: log_unknown_state(dispatcher, command, state)
    end
  end

  defp put_next_state(_dispatcher, _command, _result), do: :ok

  defp log_unknown_state(dispatcher, command, state) do
    Logger.warning(
      "#{inspect(dispatcher.robot)}: command #{inspect(command.name)} ended with the unknown " <>
        "next_state #{inspect(state)}, which is ignored; the states are " <>
        inspect(dispatcher.states)
    )
  end

  # A request is decided again when the executions that it preempts have ended.
  defp retry_waiting(dispatcher) do
    {blocked, ready} =
      Enum.split_with(dispatcher.waiting, fn {ids, _request} ->
        Enum.any?(ids, &is_map_key(dispatcher.running, &1))
      end)

    Enum.reduce(ready, %{dispatcher | waiting: blocked}, fn {_ids, request}, dispatcher ->
      request(dispatcher, request)
    end)
  end

  # Timers

  defp start_timer(:infinity, _event), do: nil
  defp start_timer(after_ms, event), do: :erlang.start_timer(after_ms, self(), event)

  defp cancel_timer(nil), do: :ok

  defp cancel_timer(timer) do
    _ = :erlang.cancel_timer(timer)
    :ok
  end

  # Messages

  defp publish_end(robot, name, id, {:error, reason}),
    do: publish_event(robot, name, id, :failed, %{reason: reason})

  defp publish_end(robot, name, id, result),
    do: publish_event(robot, name, id, :succeeded, %{result: elem(result, 1)})

  defp publish_event(robot, name, id, status, data) do
    event = Message.new!(Event, :command, status: status, data: data)
    publish(robot, [:command, name, id], event)
  end

  # Transitions of the safety state are published by BB.Safety.
  defp publish_transition(%{robot: robot} = dispatcher, before) do
    case Executions.state(robot) do
      ^before ->
        :ok

      now ->
        if Enum.all?([before, now], &(&1 == :executing or &1 in dispatcher.states)),
          do: publish_states(robot, before, now)
    end

    dispatcher
  end

  defp publish_states(robot, from, to) do
    transition = Message.new!(Transition, :state_machine, from: from, to: to)
    publish(robot, [:state_machine], transition)
  end

  defp publish(robot, path, message) do
    PubSub.publish(robot, path, message)
  rescue
    # The pubsub is being restarted: there is no subscriber.
    ArgumentError -> :ok
  end
end

defmodule BB.Command.Server do
  @moduledoc """
  The process of one execution of a command. `BB.Command.Dispatcher` starts one for each below
  `BB.CommandSupervisor`, and lets it begin.

  The server resolves the references to parameters in the options of the handler, checks the
  options against the handler's schema, calls `init/1` and `handle_command/3`, and then passes
  requests and messages to the handler, as `BB.Component.Server` does for a component. At its end
  it takes the result from the handler (`BB.Command.Outcome`) and reports it to the dispatcher
  before a waiting process gets it: whoever has the result can execute the next command.

  It traps exits, so that it gives a result also when it is stopped. The exit of a linked process
  stops it, unless the handler traps exits for itself.
  """
  @moduledoc no_example: "internal: BB.Command shows a handler"

  use GenServer, restart: :temporary

  require Logger

  alias BB.{Callback, Parameter}
  alias BB.Command.{Context, Dispatcher, Outcome, Results}
  alias BB.Component.{OptionsSchema, UserState}
  alias BB.Dsl.Child
  alias BB.Parameter.Reference
  alias BB.Robot.Runtime
  alias BB.Safety.Records

  @enforce_keys [:robot, :id, :command, :goal, :armed?]
  defstruct [
    :robot,
    :id,
    :command,
    :goal,
    :armed?,
    :module,
    :given,
    :options,
    :watch,
    :user_state,
    :result,
    :timeout_at_ms,
    values: %{},
    ready?: false,
    stopped?: false,
    traps_exits?: true,
    waiting: []
  ]

  @typedoc "The arguments of an execution; `armed?` is whether the robot was armed at its start."
  @type argument :: %{
          robot: module(),
          command: BB.Dsl.Command.t(),
          goal: map(),
          id: reference(),
          armed?: boolean()
        }

  @begin {__MODULE__, :begin}
  @crash {__MODULE__, :crash}

  @doc "Starts the process of an execution, which waits for `begin/1`."
  @spec start_link(argument()) :: GenServer.on_start()
  def start_link(argument), do: GenServer.start_link(__MODULE__, argument)

  @doc "Lets an execution begin."
  @spec begin(pid()) :: :ok
  def begin(pid) do
    send(pid, @begin)
    :ok
  end

  @doc "Stops an execution with a reason."
  @spec stop(pid(), term()) :: :ok
  def stop(pid, reason) do
    send(pid, {__MODULE__, :stop, reason})
    :ok
  end

  @impl GenServer
  def init(%{robot: robot, command: command} = argument) do
    Process.flag(:trap_exit, true)
    Results.open(robot, command.name)
    {:ok, module, given} = Child.parse(command.handler)
    {:ok, struct!(__MODULE__, Map.merge(argument, %{module: module, given: given}))}
  end

  @impl GenServer
  def handle_continue(argument, server), do: run_callback(server, :handle_continue, [argument])

  @impl GenServer
  def handle_call(request, from, server), do: run_callback(server, :handle_call, [request, from])

  @impl GenServer
  def handle_cast(request, server), do: run_callback(server, :handle_cast, [request])

  @impl GenServer
  def handle_info(@begin, server), do: start(server)

  def handle_info({Results, :await, ref}, server),
    do: UserState.continue(%{server | waiting: [ref | server.waiting]})

  def handle_info({__MODULE__, :stop, reason}, server),
    do: {:stop, reason, %{server | stopped?: true}}

  def handle_info({__MODULE__, :safety, state}, %{ready?: true} = server),
    do: handle_safety_state(server, state, &UserState.continue/1)

  # `start/1` compares the state of the robot.
  def handle_info({__MODULE__, :safety, _state}, server), do: {:noreply, server}

  def handle_info({:EXIT, _pid, reason}, %{traps_exits?: true} = server) do
    if reason == :normal, do: UserState.continue(server), else: {:stop, reason, server}
  end

  def handle_info({Parameter, watch, values}, %{watch: watch} = server) do
    server = %{server | values: Map.merge(server.values, values)}
    if server.ready?, do: update_options(server), else: {:noreply, server}
  end

  def handle_info({:DOWN, watch, :process, _pid, _reason}, %{watch: watch} = server),
    do: fail(server, :parameters_restart)

  def handle_info(message, server), do: run_callback(server, :handle_info, [message])

  @impl GenServer
  def terminate(reason, %{command: command} = server) do
    result = result(Process.get(@crash), reason, server)
    if server.ready?, do: clean_up(server, reason)
    Dispatcher.finish(server.robot, server.id, result)
    Results.put(server.robot, command.name, result)
    for ref <- waiting(server.waiting), do: send(ref, {ref, result})
  end

  # Those whose request has arrived since.
  defp waiting(refs) do
    receive do
      {Results, :await, ref} -> waiting([ref | refs])
    after
      0 -> refs
    end
  end

  defp result({:crash, exception}, _reason, server),
    do: {:error, Outcome.crash(server.command.name, exception)}

  defp result(nil, _reason, %{result: {:error, _} = error}), do: error
  defp result(nil, reason, %{ready?: false}), do: {:error, {:command_failed, reason}}

  defp result(nil, reason, server) do
    if server.stopped? or Outcome.orderly?(reason),
      do: Outcome.of(server.module, server.command.name, server.user_state, reason),
      else: {:error, Outcome.crash(server.command.name, reason)}
  end

  defp clean_up(server, reason) do
    server.module.terminate(reason, server.user_state)
  catch
    kind, raised ->
      Logger.error(
        "#{inspect(server.module)}.terminate/2: " <>
          Exception.format_banner(kind, Callback.showable(raised), __STACKTRACE__)
      )
  end

  # Starting

  defp start(server) do
    with {:ok, server} <- watch_parameters(server),
         {:ok, options} <- check_options(server),
         {{:ok, state}, traps_exits?} <- run_init(server, options) do
      run_command(%{
        server
        | options: options,
          user_state: state,
          ready?: true,
          traps_exits?: not traps_exits?
      })
    else
      {{:stop, reason}, _traps_exits?} -> fail(server, reason)
      {:error, reason} -> fail(server, reason)
      {other, _traps_exits?} -> {:stop, {:bad_return_value, Callback.showable(other)}, server}
    end
  end

  # With whether the handler traps exits for itself.
  defp run_init(server, options) do
    Process.flag(:trap_exit, false)
    returned = apply_callback(server, :init, [options])
    {returned, Process.flag(:trap_exit, true)}
  end

  defp fail(server, reason),
    do: {:stop, {:shutdown, :failed}, %{server | result: {:error, Callback.showable(reason)}}}

  # The robot may have been disarmed since the command was allowed.
  defp run_command(%{armed?: true} = server) do
    case Records.state(server.robot) do
      :armed -> handle_command(server)
      state -> handle_safety_state(server, state, &handle_command/1)
    end
  end

  defp run_command(server), do: handle_command(server)

  defp handle_command(server),
    do: run_callback(server, :handle_command, [server.goal, server.options[:context]])

  defp handle_safety_state(server, state, continue) do
    case apply_callback(server, :handle_safety_state_change, [state, server.user_state]) do
      {:continue, state} -> continue.(%{server | user_state: state})
      {:noreply, state} -> continue.(%{server | user_state: state})
      other -> handle_return(server, other)
    end
  end

  # Options

  defp watch_parameters(server) do
    with [_ | _] = paths <- Reference.paths(server.given),
         {:ok, watch, values} <- Parameter.watch(server.robot, paths) do
      {:ok, %{server | watch: watch, values: values}}
    else
      [] -> {:ok, server}
      error -> error
    end
  end

  defp check_options(%{robot: robot} = server) do
    given = Reference.resolve(server.given, &Map.fetch!(server.values, &1))
    own = [bb: %{robot: robot}, goal: server.goal, context: context(server)]

    with {:ok, options} <- validate(server.module, given), do: {:ok, own ++ options}
  end

  defp validate(module, given) do
    if Code.ensure_loaded?(module),
      do: OptionsSchema.validate(module, given, []),
      else: {:error, {:unknown_handler, module}}
  end

  defp context(%{options: [_ | _] = options}), do: options[:context]

  defp context(%{robot: robot, id: id}) do
    %Context{
      robot_module: robot,
      robot: Runtime.get_robot(robot),
      robot_state: Runtime.get_robot_state(robot),
      execution_id: id
    }
  end

  defp update_options(%{options: options} = server) do
    case check_options(server) do
      {:ok, ^options} -> UserState.continue(server)
      {:ok, options} -> handle_options(%{server | options: options})
      {:error, error} -> fail(server, error)
    end
  end

  defp handle_options(server) do
    case apply_callback(server, :handle_options, [server.options, server.user_state]) do
      {:ok, state} -> UserState.continue(%{server | user_state: state})
      {:stop, reason} -> handle_return(server, {:stop, reason, server.user_state})
      other -> {:stop, {:bad_return_value, Callback.showable(other)}, server}
    end
  end

  # Callbacks

  defp run_callback(%{ready?: false} = server, _callback, _arguments), do: {:noreply, server}

  defp run_callback(server, callback, arguments) do
    handle_return(server, apply_callback(server, callback, arguments ++ [server.user_state]))
  end

  # `terminate/2` finds the exception, which is the result.
  defp apply_callback(server, callback, arguments) do
    apply(server.module, callback, arguments)
  catch
    kind, reason ->
      Process.put(@crash, {:crash, Outcome.normalize(kind, reason, __STACKTRACE__)})
      :erlang.raise(kind, Callback.showable(reason), __STACKTRACE__)
  end

  defp handle_return(server, {:stop, reason, state}),
    do: {:stop, Callback.showable(reason), put_stopped(server, state)}

  defp handle_return(server, {:stop, reason, reply, state}),
    do: {:stop, Callback.showable(reason), reply, put_stopped(server, state)}

  defp handle_return(server, returned) do
    with :error <- UserState.put_returned(server, returned),
         do: {:stop, {:bad_return_value, Callback.showable(returned)}, server}
  end

  defp put_stopped(server, state), do: %{UserState.put(server, state) | stopped?: true}
end

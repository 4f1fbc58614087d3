defmodule BB.Component.Server do
  @moduledoc """
  The process of a component, of whichever kind.

  A keeper (`BB.Component.Keeper`) starts one for its component; a driver's test starts one by
  `BB.Sensor.Server`.

  The server resolves the references to parameters in the options and in the transmission, checks
  the options against the callback module's schema, calls `init/1`, and then passes each request,
  message and time-out to the callback module.

  ## Arguments

    * `:__callback_module__` - the module
    * `:__kind__` - the kind of component, a module with the behaviour `BB.Component`
    * `:__keeper__` - the keeper that starts the server, if any
    * `:__heartbeat__` - the heartbeat that it shares with its keeper (`BB.Component.Heartbeat`)
    * `:bb` - `%{robot: robot_module, path: path}`
    * any other argument is an option of the callback module

  ## Start

  A server with a keeper calls `init/1` of the callback module after `start_link/1` has returned,
  so that a device that does not answer delays no other process. It then reports to its keeper
  (`t:report/0`). For a server without a keeper, `start_link/1` returns the result of `init/1`.

  ## Parameters

  The server watches the parameters (`BB.Parameter.watch/2`) before it reads their values. It
  calls `handle_options/2` once for each change that makes another set of options: two parameters
  that one `BB.Parameter.set_many/2` sets are one change, and a parameter that is set to its
  current value is none. Options that the schema refuses then, or `{:stop, reason}`, stop the
  process. The callback module receives no message of this watch. Its own subscriptions, also
  below `[:param]`, reach its `handle_info/2` as any message does.

  ## Commands

  A kind with `c:BB.Component.component_request/4` takes requests before the callback module does.
  A command goes to `handle_command/2`. A call of it gets the reply, or `{:ok, :accepted}` when
  the callback returns none.

  ## Exits

  A server with a keeper does not trap exits: it dies with its keeper, even while a callback
  hangs, and with any process that the callback module has linked to it. The keeper stops it by a
  system message, which runs `terminate/2`. A server without a keeper traps exits, to the same
  effect under any supervisor.
  """
  @moduledoc no_example: "internal: BB.Sensor shows a callback module, BB.Sensor.Server a test"

  use GenServer

  alias BB.Callback
  alias BB.Component.{Heartbeat, OptionsCheck, Resolution, UserState}

  @enforce_keys [:module, :kind, :bb, :resolution]
  defstruct [
    :module,
    :kind,
    :bb,
    :resolution,
    :options,
    :watch,
    :keeper,
    :started,
    :user_state,
    :timeout_at_ms,
    values: %{},
    ready?: false,
    traps_exits?: false
  ]

  @typedoc """
  A report to the keeper: `:up` when `init/1` has succeeded, `{:stopping, reason}` before the
  server carries out a callback's `{:stop, reason, state}`, and `{:trouble, reason}` from
  `trouble/1`.

  After an `init/1` that returned `{:stop, reason}` or `:ignore` the server exits with
  `{:shutdown, {BB.Component.Server, {:absent, reason}}}` or
  `{:shutdown, {BB.Component.Server, :ignored}}`.
  """
  @type report :: {__MODULE__, pid(), :up | {:stopping, term()} | {:trouble, term()}}

  @start {__MODULE__, :start}
  @keeper {__MODULE__, :keeper}
  @own [:__callback_module__, :__kind__, :__keeper__, :__heartbeat__, :bb]

  @doc """
  Starts a component's process, registered under the component's name while its robot runs.

  `genserver_opts` are those of `GenServer.start_link/3`. A `:name` among them is used instead.
  """
  @spec start_link(keyword(), GenServer.options()) :: GenServer.on_start()
  def start_link(args, genserver_opts \\ []) do
    %{robot: robot, path: path} = Keyword.fetch!(args, :bb)
    name = name(args[:__keeper__], robot, List.last(path))
    GenServer.start_link(__MODULE__, args, Keyword.merge(name, genserver_opts))
  end

  @doc """
  Reports trouble to the keeper of the calling component, which runs on.

  Without a keeper it does nothing.
  """
  @spec trouble(term()) :: :ok
  def trouble(reason) do
    keeper = Process.get(@keeper)
    _ = if keeper, do: send(keeper, {__MODULE__, self(), {:trouble, Callback.showable(reason)}})
    :ok
  end

  # With a keeper the server has its name or does not start: the registry may be about to restart.
  # A driver's test need not have a robot.
  defp name(keeper, robot, name) do
    if keeper || Process.whereis(BB.Process.registry_name(robot)),
      do: [name: BB.Process.via(robot, name)],
      else: []
  end

  @impl GenServer
  def init(args) do
    {own, options} = Keyword.split(args, @own)

    module = Keyword.fetch!(own, :__callback_module__)
    kind = Keyword.fetch!(own, :__kind__)
    bb = Map.take(Keyword.fetch!(own, :bb), [:robot, :path])
    Heartbeat.adopt(own[:__heartbeat__])
    _ = if own[:__keeper__], do: Process.put(@keeper, own[:__keeper__])

    server = %__MODULE__{
      module: module,
      kind: kind,
      bb: bb,
      keeper: own[:__keeper__],
      resolution: Resolution.new(kind, module, bb, options)
    }

    if server.keeper, do: {:ok, server, {:continue, @start}}, else: start(server)
  end

  @impl GenServer
  def handle_continue(@start, server) do
    case start(server) do
      {:ok, server} -> {:noreply, report(server, :up)}
      {:ok, server, next} -> {:noreply, report(server, :up), next}
      {:stop, reason} -> {:stop, {:shutdown, {__MODULE__, {:absent, reason}}}, server}
      :ignore -> {:stop, {:shutdown, {__MODULE__, :ignored}}, server}
    end
  end

  def handle_continue(argument, server),
    do: run_callback(server, :handle_continue, [argument])

  @impl GenServer
  def handle_call(request, from, server) do
    case route(server, :call, request) do
      :pass -> run_callback(server, :handle_call, [request, from])
      {:command, message} -> run_command(server, message, &accept/1)
      {:answer, reply} -> answer(server, reply)
    end
  end

  @impl GenServer
  def handle_cast(request, server), do: handle_sent(server, :cast, :handle_cast, request)

  @impl GenServer
  def handle_info({:EXIT, _pid, reason}, %{traps_exits?: true} = server) do
    if reason == :normal, do: UserState.continue(server), else: {:stop, reason, server}
  end

  def handle_info({BB.Parameter, watch, values}, %{watch: watch} = server),
    do: update_options(%{server | values: Map.merge(server.values, values)})

  # The robot's parameters are being restarted, and the component with them.
  def handle_info({:DOWN, watch, :process, _pid, _reason}, %{watch: watch} = server),
    do: {:stop, {:shutdown, {__MODULE__, {:absent, :parameters_restart}}}, server}

  def handle_info(message, server), do: handle_sent(server, :message, :handle_info, message)

  @impl GenServer
  def terminate(reason, %{ready?: true} = server),
    do: apply_callback(server, :terminate, [reason, server.user_state])

  def terminate(_reason, _server), do: :ok

  # Starting: the options, then init/1 of the callback module

  defp start(server) do
    with {:ok, server} <- watch_parameters(server),
         {:ok, options} <- check_options(server) do
      server = start_kind(%{server | options: options})
      server |> run_init() |> handle_init(server)
    else
      {:error, error} -> {:stop, error}
    end
  end

  defp check_options(server),
    do: [{server.resolution, server.values}] |> OptionsCheck.run() |> hd()

  # The values are those at the moment from which on changes are reported.
  defp watch_parameters(server) do
    with [_ | _] = paths <- Resolution.paths(server.resolution),
         {:ok, watch, values} <- BB.Parameter.watch(server.bb.robot, paths) do
      {:ok, %{server | watch: watch, values: values}}
    else
      [] -> {:ok, server}
      error -> error
    end
  end

  defp start_kind(%{kind: kind, module: module, options: options} = server) do
    if function_exported?(kind, :component_start, 2),
      do: %{server | started: {:ok, kind.component_start(module, options)}},
      else: server
  end

  defp run_init(%{module: module, kind: kind, bb: bb, options: options} = server) do
    metadata = %{robot: bb.robot, path: bb.path, module: module}
    register_disarm(server)

    init = fn -> {apply_callback(server, :init, [options]), metadata} end
    BB.Telemetry.span([:bb, kind.component_kind(), :init], metadata, init, apart: true)
  end

  # Before the callbacks have the options, so that no hardware moves before its handler is known.
  defp register_disarm(%{module: module, bb: bb, options: options}) do
    if function_exported?(module, :disarm, 1),
      do: BB.Safety.register(module, robot: bb.robot, path: bb.path, opts: options)
  end

  defp handle_init({:ok, state}, server), do: {:ok, put_ready(server, state)}

  defp handle_init({:ok, state, next}, server),
    do: {:ok, server |> put_ready(state) |> UserState.put(state, next), next}

  defp handle_init({:stop, reason}, _server), do: {:stop, Callback.showable(reason)}
  defp handle_init({:error, reason}, _server), do: {:stop, Callback.showable(reason)}
  defp handle_init(:ignore, _server), do: :ignore
  defp handle_init(other, _server), do: exit({:bad_return_value, Callback.showable(other)})

  # Without a keeper the server traps exits so that terminate/2 runs, unless the callback module
  # traps them for itself.
  defp put_ready(server, state) do
    traps_exits? = is_nil(server.keeper) and not Process.flag(:trap_exit, true)
    %{server | user_state: state, ready?: true, traps_exits?: traps_exits?}
  end

  # New values of parameters

  defp update_options(%{options: options} = server) do
    case check_options(server) do
      {:ok, ^options} -> UserState.continue(server)
      {:ok, options} -> handle_options(%{server | options: options})
      {:error, error} -> {:stop, error, report(server, {:stopping, error})}
    end
  end

  defp handle_options(server) do
    register_disarm(server)

    case apply_callback(server, :handle_options, [server.options, server.user_state]) do
      {:ok, state} -> UserState.continue(%{server | user_state: state})
      {:stop, reason} -> handle_return(server, {:stop, reason, server.user_state})
      other -> {:stop, {:bad_return_value, Callback.showable(other)}, server}
    end
  end

  # Callbacks

  defp run_callback(server, callback, arguments) do
    handle_return(server, apply_callback(server, callback, arguments ++ [server.user_state]))
  end

  # The machine's log shows why a process exits, and must be able to.
  defp apply_callback(server, callback, arguments) do
    if function_exported?(server.kind, :component_apply, 3),
      do: server.kind.component_apply(server.module, callback, arguments),
      else: apply(server.module, callback, arguments)
  catch
    kind, reason -> :erlang.raise(kind, Callback.showable(reason), __STACKTRACE__)
  end

  # Requests that the kind handles

  defp route(%{started: nil}, _transport, _request), do: :pass

  defp route(%{kind: kind, started: {:ok, started}} = server, transport, request),
    do: kind.component_request(transport, request, started, server.options)

  defp handle_sent(server, transport, callback, request) do
    case route(server, transport, request) do
      :pass -> run_callback(server, callback, [request])
      {:command, message} -> run_command(server, message, &drop_reply/1)
      {:answer, _reply} -> UserState.continue(server)
    end
  end

  defp run_command(server, message, change) do
    returned = apply_callback(server, :handle_command, [message, server.user_state])
    handle_return(server, change.(returned))
  end

  # A call of a command is answered at once.
  defp accept({:noreply, state}), do: {:reply, {:ok, :accepted}, state}
  defp accept({:noreply, state, next}), do: {:reply, {:ok, :accepted}, state, next}
  defp accept(other), do: other

  defp drop_reply({:reply, _reply, state}), do: {:noreply, state}
  defp drop_reply({:reply, _reply, state, next}), do: {:noreply, state, next}
  defp drop_reply({:stop, reason, _reply, state}), do: {:stop, reason, state}
  defp drop_reply(other), do: other

  defp answer(server, reply) do
    case UserState.continue(server) do
      {:noreply, server} -> {:reply, reply, server}
      {:noreply, server, timeout_ms} -> {:reply, reply, server, timeout_ms}
    end
  end

  # Puts the callback module's new state into the server's.

  defp handle_return(server, {:stop, reason, state}) do
    reason = Callback.showable(reason)
    {:stop, reason, server |> report({:stopping, reason}) |> UserState.put(state)}
  end

  defp handle_return(server, {:stop, reason, reply, state}) do
    reason = Callback.showable(reason)
    {:stop, reason, reply, server |> report({:stopping, reason}) |> UserState.put(state)}
  end

  defp handle_return(server, returned) do
    with :error <- UserState.put_returned(server, returned), do: Callback.showable(returned)
  end

  defp report(%{keeper: nil} = server, _report), do: server

  defp report(server, report) do
    send(server.keeper, {__MODULE__, self(), report})
    server
  end
end

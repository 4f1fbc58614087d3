defmodule BB.Component.Server do
  @moduledoc """
  The one process behind sensors, and behind every other kind of component.

  It resolves the references to parameters in the options and in the transmission, checks the options against the callback
  module's schema, calls `init/1` and then passes each request, message and time-out on. Its arguments are a keyword list:

    * `:__callback_module__` - the module
    * `:__kind__` - the kind of component, a module with the behaviour `BB.Component`
    * `:__keeper__` - the keeper that starts it, when there is one
    * `:__heartbeat__` - what it shares with that keeper (`BB.Component.Heartbeat`)
    * `:bb` - `%{robot: R, path: path}`
    * all others are the user's options

  Started by a keeper, it calls the user's `init/1` after `start_link/1` has returned, so that a device which does not
  answer holds up nobody, and reports to the keeper (`t:report/0`). Started by anyone else, `start_link/1` returns what
  became of `init/1`.

  It watches the parameters before it has their values (`BB.Parameter.watch/2`), and calls `handle_options/2` once for each change
  that makes another set of options: two parameters set by one `BB.Parameter.set_many/2` are one change, a parameter set to the
  value that it has is none. Options that are wrong then, or `{:stop, reason}`, stop the process. The callback module sees nothing of the
  watch; what it has subscribed to itself, below `[:param]` too, reaches its `handle_info/2` as any message does.

  It does not trap exits under a keeper: it dies with its keeper, even while a callback hangs, and it dies with a process
  that the callback module has linked to it. The keeper stops it by a system message, which runs `terminate/2`. Without a
  keeper it traps exits for the same effect under any supervisor.
  """

  use GenServer

  alias BB.Callback
  alias BB.Component.{Heartbeat, OptionsCheck, Resolution}

  @enforce_keys [:module, :kind, :bb, :resolution]
  defstruct [
    :module,
    :kind,
    :bb,
    :resolution,
    :options,
    :watch,
    :keeper,
    :user_state,
    :wake_at,
    values: %{},
    ready?: false,
    guarded?: false
  ]

  @typedoc """
  What a keeper hears: `:up` when `init/1` is done, `{:stopping, reason}` before a callback's `{:stop, reason, state}` is
  carried out, `{:trouble, reason}` for what is wrong although it goes on (`trouble/1`). Then comes the exit; `{:shutdown, {BB.Component.Server, outcome}}` is that of an `init/1` which returned
  `{:stop, reason}` (outcome `{:absent, reason}`) or `:ignore` (`:ignored`).
  """
  @type report :: {__MODULE__, pid(), :up | {:stopping, term()} | {:trouble, term()}}

  @start {__MODULE__, :start}
  @keeper {__MODULE__, :keeper}
  @own [:__callback_module__, :__kind__, :__keeper__, :__heartbeat__, :bb]

  @doc "Starts a component and registers it under its name while its robot runs."
  @spec start_link(keyword()) :: GenServer.on_start()
  def start_link(args) do
    %{robot: robot, path: path} = Keyword.fetch!(args, :bb)
    GenServer.start_link(__MODULE__, args, name(args[:__keeper__], robot, List.last(path)))
  end

  @doc "Tells the keeper of the calling component, if it has one, what is wrong although it goes on."
  @spec trouble(term()) :: :ok
  def trouble(reason) do
    keeper = Process.get(@keeper)
    _ = if keeper, do: send(keeper, {__MODULE__, self(), {:trouble, Callback.showable(reason)}})
    :ok
  end

  # A keeper's has its name or does not start: the registry may be about to be started again. A
  # driver's test need not have a robot.
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
    do: settle(server, run(server, :handle_continue, [argument, server.user_state]))

  @impl GenServer
  def handle_call(request, from, server),
    do: settle(server, run(server, :handle_call, [request, from, server.user_state]))

  @impl GenServer
  def handle_cast(request, server),
    do: settle(server, run(server, :handle_cast, [request, server.user_state]))

  @impl GenServer
  def handle_info({:EXIT, _pid, reason}, %{guarded?: true} = server) do
    if reason == :normal, do: resume(server), else: {:stop, reason, server}
  end

  def handle_info({BB.Parameter, watch, values}, %{watch: watch} = server),
    do: take_on(%{server | values: Map.merge(server.values, values)})

  # The robot's parameters are started anew. So is the component, with them.
  def handle_info({:DOWN, watch, :process, _pid, _reason}, %{watch: watch} = server),
    do: {:stop, {:shutdown, {__MODULE__, {:absent, :parameters_restart}}}, server}

  def handle_info(message, server),
    do: settle(server, run(server, :handle_info, [message, server.user_state]))

  @impl GenServer
  def terminate(reason, %{ready?: true} = server),
    do: run(server, :terminate, [reason, server.user_state])

  def terminate(_reason, _server), do: :ok

  # Starting: the options, then the user's init.

  defp start(server) do
    with {:ok, server} <- watch(server),
         {:ok, options} <- check(server) do
      server = %{server | options: options}
      server |> run_init() |> started(server)
    else
      {:error, error} -> {:stop, error}
    end
  end

  defp check(server), do: [{server.resolution, server.values}] |> OptionsCheck.run() |> hd()

  # The values are those of the moment from which on it hears of changes.
  defp watch(server) do
    with [_ | _] = paths <- Resolution.paths(server.resolution),
         {:ok, watch, values} <- BB.Parameter.watch(server.bb.robot, paths) do
      {:ok, %{server | watch: watch, values: values}}
    else
      [] -> {:ok, server}
      error -> error
    end
  end

  defp run_init(%{module: module, kind: kind, bb: bb, options: options} = server) do
    metadata = %{robot: bb.robot, path: bb.path, module: module}
    enlist(server)

    init = fn -> {run(server, :init, [options]), metadata} end
    BB.Telemetry.span([:bb, kind.component_kind(), :init], metadata, init, apart: true)
  end

  # Before its callbacks have the options, so that the hardware never moves without a handler that stops it.
  defp enlist(%{module: module, bb: bb, options: options}) do
    if function_exported?(module, :disarm, 1),
      do: BB.Safety.register(module, robot: bb.robot, path: bb.path, opts: options)
  end

  defp started({:ok, state}, server), do: {:ok, ready(server, state)}

  defp started({:ok, state, next}, server) do
    server = ready(server, state)
    {:ok, wake_after(server, next), next}
  end

  defp started({:stop, reason}, _server), do: {:stop, Callback.showable(reason)}
  defp started({:error, reason}, _server), do: {:stop, Callback.showable(reason)}
  defp started(:ignore, _server), do: :ignore
  defp started(other, _server), do: exit({:bad_return_value, Callback.showable(other)})

  # Without a keeper, exits are trapped for the sake of terminate/2, unless the callback module traps them for itself.
  defp ready(server, state) do
    guarded? = is_nil(server.keeper) and not Process.flag(:trap_exit, true)
    %{server | user_state: state, ready?: true, guarded?: guarded?}
  end

  # New values of parameters

  defp take_on(%{options: options} = server) do
    case check(server) do
      {:ok, ^options} -> resume(server)
      {:ok, options} -> taken_on(%{server | options: options})
      {:error, error} -> {:stop, error, report(server, {:stopping, error})}
    end
  end

  defp taken_on(server) do
    enlist(server)

    case run(server, :handle_options, [server.options, server.user_state]) do
      {:ok, state} -> resume(%{server | user_state: state})
      {:stop, reason} -> settle(server, {:stop, reason, server.user_state})
      other -> {:stop, {:bad_return_value, Callback.showable(other)}, server}
    end
  end

  # What ends the process is shown by the log of the whole machine, which must be able to.
  defp run(server, callback, arguments) do
    apply(server.module, callback, arguments)
  catch
    kind, reason -> :erlang.raise(kind, Callback.showable(reason), __STACKTRACE__)
  end

  # What a callback returned, with the user's state put into the server's.

  defp settle(server, {:noreply, state}), do: {:noreply, keep(server, state)}
  defp settle(server, {:noreply, state, next}), do: {:noreply, keep(server, state, next), next}
  defp settle(server, {:reply, reply, state}), do: {:reply, reply, keep(server, state)}

  defp settle(server, {:reply, reply, state, next}),
    do: {:reply, reply, keep(server, state, next), next}

  defp settle(server, {:stop, reason, state}) do
    reason = Callback.showable(reason)
    {:stop, reason, server |> report({:stopping, reason}) |> keep(state)}
  end

  defp settle(server, {:stop, reason, reply, state}) do
    reason = Callback.showable(reason)
    {:stop, reason, reply, server |> report({:stopping, reason}) |> keep(state)}
  end

  defp settle(_server, other), do: Callback.showable(other)

  defp keep(server, state, next \\ nil),
    do: wake_after(%{server | user_state: state}, next)

  # A message of the server's own must not use up the user's time-out.

  defp wake_after(server, timeout_ms) when is_integer(timeout_ms),
    do: %{server | wake_at: System.monotonic_time(:millisecond) + timeout_ms}

  defp wake_after(server, _next), do: %{server | wake_at: nil}

  defp resume(%{wake_at: nil} = server), do: {:noreply, server}

  defp resume(server),
    do: {:noreply, server, max(server.wake_at - System.monotonic_time(:millisecond), 0)}

  defp report(%{keeper: nil} = server, _what), do: server

  defp report(server, what) do
    send(server.keeper, {__MODULE__, self(), what})
    server
  end
end

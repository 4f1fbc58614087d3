defmodule BB.Component.Server do
  @moduledoc """
  The one process behind sensors, and behind every other kind of component.

  It checks the options against the callback module's schema, calls `init/1` and then passes each request, message and
  time-out on. Its arguments are a keyword list:

    * `:__callback_module__` - the module
    * `:__kind__` - the kind of component, a module with the behaviour `BB.Component`
    * `:__keeper__` - the keeper that starts it, when there is one
    * `:bb` - `%{robot: R, path: path}`
    * all others are the user's options

  Started by a keeper, it calls the user's `init/1` after `start_link/1` has returned, so that a device which does not
  answer holds up nobody, and reports to the keeper (`t:report/0`). Started by anyone else, `start_link/1` returns what
  became of `init/1`.

  It does not trap exits under a keeper: it dies with its keeper, even while a callback hangs, and it dies with a process
  that the callback module has linked to it. The keeper stops it by a system message, which runs `terminate/2`. Without a
  keeper it traps exits for the same effect under any supervisor.
  """

  use GenServer

  alias BB.Component.Options

  @enforce_keys [:module, :kind, :bb, :options]
  defstruct [
    :module,
    :kind,
    :bb,
    :options,
    :keeper,
    :user_state,
    :wake_at,
    ready?: false,
    guarded?: false
  ]

  @typedoc """
  What a keeper hears: `:up` when `init/1` is done, `{:stopping, reason}` before a callback's `{:stop, reason, state}` is
  carried out. Then comes the exit; `{:shutdown, {BB.Component.Server, outcome}}` is that of an `init/1` which returned
  `{:stop, reason}` (outcome `{:absent, reason}`) or `:ignore` (`:ignored`).
  """
  @type report :: {__MODULE__, pid(), :up | {:stopping, term()}}

  @start {__MODULE__, :start}

  @doc "Starts a component and registers it under its name while its robot runs."
  @spec start_link(keyword()) :: GenServer.on_start()
  def start_link(args) do
    %{robot: robot, path: path} = Keyword.fetch!(args, :bb)
    GenServer.start_link(__MODULE__, args, name(robot, List.last(path)))
  end

  defp name(robot, name) do
    if Process.whereis(BB.Process.registry_name(robot)),
      do: [name: BB.Process.via(robot, name)],
      else: []
  end

  @impl GenServer
  def init(args) do
    {own, options} = Keyword.split(args, [:__callback_module__, :__kind__, :__keeper__, :bb])

    server = %__MODULE__{
      module: Keyword.fetch!(own, :__callback_module__),
      kind: Keyword.fetch!(own, :__kind__),
      bb: Map.take(Keyword.fetch!(own, :bb), [:robot, :path]),
      keeper: own[:__keeper__],
      options: options
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
    do: settle(server, server.module.handle_continue(argument, server.user_state))

  @impl GenServer
  def handle_call(request, from, server),
    do: settle(server, server.module.handle_call(request, from, server.user_state))

  @impl GenServer
  def handle_cast(request, server),
    do: settle(server, server.module.handle_cast(request, server.user_state))

  @impl GenServer
  def handle_info({:EXIT, _pid, reason}, %{guarded?: true} = server) do
    if reason == :normal, do: resume(server), else: {:stop, reason, server}
  end

  def handle_info(message, server),
    do: settle(server, server.module.handle_info(message, server.user_state))

  @impl GenServer
  def terminate(reason, %{ready?: true} = server),
    do: server.module.terminate(reason, server.user_state)

  def terminate(_reason, _server), do: :ok

  # Starting: the options, then the user's init.

  defp start(server) do
    case Options.check(server.module, server.options, server.bb.path) do
      {:ok, options} -> server |> run_init(options) |> started(server)
      {:error, error} -> {:stop, error}
    end
  end

  defp run_init(server, options) do
    %{module: module, kind: kind, bb: bb} = server
    options = [bb: bb] ++ kind.component_options(bb.robot, List.last(bb.path)) ++ options
    metadata = %{robot: bb.robot, path: bb.path, module: module}
    enlist(module, bb, options)

    BB.Telemetry.span([:bb, kind.component_kind(), :init], metadata, fn ->
      {module.init(options), metadata}
    end)
  end

  # Before init, so that the hardware never moves without a handler that stops it.
  defp enlist(module, bb, options) do
    if function_exported?(module, :disarm, 1),
      do: BB.Safety.register(module, robot: bb.robot, path: bb.path, opts: options)
  end

  defp started({:ok, state}, server), do: {:ok, ready(server, state)}

  defp started({:ok, state, next}, server) do
    server = ready(server, state)
    {:ok, wake_after(server, next), next}
  end

  defp started({:stop, reason}, _server), do: {:stop, reason}
  defp started({:error, reason}, _server), do: {:stop, reason}
  defp started(:ignore, _server), do: :ignore
  defp started(other, _server), do: exit({:bad_return_value, other})

  # Without a keeper, exits are trapped for the sake of terminate/2, unless the callback module traps them for itself.
  defp ready(server, state) do
    guarded? = is_nil(server.keeper) and not Process.flag(:trap_exit, true)
    %{server | user_state: state, ready?: true, guarded?: guarded?}
  end

  # What a callback returned, with the user's state put into the server's.

  defp settle(server, {:noreply, state}), do: {:noreply, keep(server, state)}
  defp settle(server, {:noreply, state, next}), do: {:noreply, keep(server, state, next), next}
  defp settle(server, {:reply, reply, state}), do: {:reply, reply, keep(server, state)}

  defp settle(server, {:reply, reply, state, next}),
    do: {:reply, reply, keep(server, state, next), next}

  defp settle(server, {:stop, reason, state}),
    do: {:stop, reason, server |> report({:stopping, reason}) |> keep(state)}

  defp settle(server, {:stop, reason, reply, state}),
    do: {:stop, reason, reply, server |> report({:stopping, reason}) |> keep(state)}

  defp settle(_server, other), do: other

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

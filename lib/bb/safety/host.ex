defmodule BB.Safety.Host do
  @moduledoc """
  Watches the application that safety serves: when it ends, however it does, all armed robots are
  disarmed, wherever they were started.

      def start(_type, _args) do
        BB.Safety.Host.enter()
        Supervisor.start_link(children, strategy: :one_for_one)
      end

      def prep_stop(state) do
        BB.Safety.Host.leave()
        state
      end

  The *host* is the process that calls `start/2`, which the application controller starts for the
  application and which lives as long as it. It calls `prep_stop/1` also when the application's
  supervisor has died; when the host itself is killed, this process hears of it. No robot is armed
  while there is no host.
  """

  use GenServer
  use BB.Process.Tolerant

  alias BB.Safety.{Records, Supervisor, Warden}

  @again_ms 5
  @patience_ms 10_000

  @doc false
  @spec start_link(keyword()) :: GenServer.on_start()
  def start_link(_opts), do: GenServer.start_link(__MODULE__, nil, name: __MODULE__)

  @doc "Starts safety, unless it runs, and makes the calling process the host."
  @spec enter() :: :ok
  def enter, do: enter(now_ms() + @patience_ms)

  defp enter(until_ms) do
    Supervisor.start()
    GenServer.call(__MODULE__, {:enter, self()}, :infinity)
  catch
    # Its supervisor was killed a moment ago.
    :exit, reason ->
      if now_ms() > until_ms, do: exit(reason)
      Process.sleep(@again_ms)
      enter(until_ms)
  end

  @doc """
  Disarms all robots that are armed, at once, and returns when all are. When the calling process
  is the host, no robot is armed from now on.
  """
  @spec leave() :: :ok
  def leave do
    Records.remove_host(self())
    Supervisor.start()

    for ref <- secure(), do: receive(do: ({:DOWN, ^ref, :process, _pid, _reason} -> :ok))
    :ok
  end

  # By processes of their own: one robot's handlers do not hold up another's, and this process
  # always answers. One that comes late leaves alone what the next host has let be armed.
  defp secure do
    moment = Warden.moment()

    for record <- Records.records() do
      {_pid, ref} = spawn_monitor(Warden, :secure, [record.robot, moment])
      ref
    end
  end

  @impl GenServer
  def init(nil) do
    Process.flag(:trap_exit, true)
    {:ok, watch(Records.host())}
  end

  @impl GenServer
  def handle_call({:enter, host}, _from, {host, _ref} = watched), do: {:reply, :ok, watched}

  def handle_call({:enter, host}, _from, {former, ref}) do
    Process.demonitor(ref, [:flush])
    _ = unless former == nil, do: secure()
    Records.put_host(host)
    {:reply, :ok, watch(host)}
  end

  @impl GenServer
  def handle_info({:DOWN, ref, :process, host, _reason}, {host, ref} = watched) do
    _ = secure()
    {:noreply, watched}
  end

  # Its supervisor was killed, perhaps together with the application and its anchor.
  @impl GenServer
  def terminate(:killed, _watched), do: spawn(&Supervisor.start/0)
  def terminate(_reason, _watched), do: :ok

  defp watch(nil), do: {nil, make_ref()}
  defp watch(host), do: {host, Process.monitor(host)}

  defp now_ms, do: System.monotonic_time(:millisecond)
end

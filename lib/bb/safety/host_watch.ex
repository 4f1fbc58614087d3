defmodule BB.Safety.HostWatch do
  @moduledoc """
  Watches the application `:ganglion`, and disarms all armed robots when it ends, for any reason.
  The application calls it when it starts and stops:

      def start(_type, _args) do
        BB.Safety.HostWatch.enter()
        Supervisor.start_link(children, strategy: :one_for_one)
      end

      def prep_stop(state) do
        BB.Safety.HostWatch.leave()
        state
      end

  The *host* is the process that calls `start/2`. The application controller starts it for the
  application, and it lives as long as the application. It calls `prep_stop/1` also when the
  application's supervisor has died. When the host itself is killed, this process receives its
  `:DOWN` message. No robot can be armed without a host.
  """

  use GenServer
  use BB.Process.Tolerant

  alias BB.Safety.{Records, Supervisor, Warden, Wardens}

  @retry_ms 5
  @patience_ms 10_000

  @doc false
  @spec start_link(keyword()) :: GenServer.on_start()
  def start_link(_opts), do: GenServer.start_link(__MODULE__, nil, name: __MODULE__)

  @doc "Makes the calling process the host, and starts the processes of safety unless they run."
  @spec enter() :: :ok
  def enter, do: enter(now_ms() + @patience_ms)

  defp enter(until_ms) do
    Supervisor.start()
    GenServer.call(__MODULE__, {:enter, self()}, :infinity)
  catch
    # The supervisor was killed a moment ago.
    :exit, reason ->
      if now_ms() > until_ms, do: exit(reason)
      Process.sleep(@retry_ms)
      enter(until_ms)
  end

  @doc """
  Disarms all armed robots, at once, and returns when all are disarmed. When the calling process
  is the host, no robot can be armed from now on.
  """
  @spec leave() :: :ok
  def leave do
    Records.remove_host(self())
    Supervisor.start()

    for ref <- secure_all(), do: receive(do: ({:DOWN, ^ref, :process, _pid, _reason} -> :ok))
    :ok
  end

  # Each robot has a process of its own, so that no robot waits for the handlers of another, and
  # this process always replies. A late process does not disarm a robot that was armed under the
  # next host.
  defp secure_all do
    moment = Warden.moment()

    for record <- Records.records() do
      {_pid, ref} = spawn_monitor(Wardens, :secure, [record.robot, moment])
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
    _ = unless former == nil, do: secure_all()
    Records.put_host(host)
    {:reply, :ok, watch(host)}
  end

  @impl GenServer
  def handle_info({:DOWN, ref, :process, host, _reason}, {host, ref} = watched) do
    _ = secure_all()
    {:noreply, watched}
  end

  # The supervisor was killed, perhaps together with the application and its anchor.
  @impl GenServer
  def terminate(:killed, _watched), do: spawn(&Supervisor.start/0)
  def terminate(_reason, _watched), do: :ok

  defp watch(nil), do: {nil, make_ref()}
  defp watch(host), do: {host, Process.monitor(host)}

  defp now_ms, do: System.monotonic_time(:millisecond)
end

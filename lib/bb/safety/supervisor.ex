defmodule BB.Safety.Supervisor do
  @moduledoc """
  Supervises the processes of `BB.Safety`, outside of all robots and all applications.

      BB.Safety.Supervisor        rest_for_one
      ├── BB.Safety.Wardens       a BB.Safety.Warden for each robot
      ├── BB.Safety.HostWatch     watches the application, whose end disarms all robots
      └── resume                  starts a warden again for each robot with a record, and ends

  It has no supervisor above it that could end it: it lives from the first start of the
  application until the end of the VM. When it is killed, `BB.Safety.Anchor` in the application
  starts it again, or `BB.Safety.HostWatch` when the anchor is gone too. `BB.Safety.Records` has
  all knowledge, so that none is lost with these processes.
  """
  @moduledoc no_example: "internal: BB.Safety is its interface"

  use Supervisor

  alias BB.Safety.{HostWatch, Records, Wardens}

  # Wardens that are killed many times do not end the others.
  @restarts [max_restarts: 1_000, max_seconds: 1]

  # Longer than the shutdown time of a supervisor's children.
  @patience_ms 6_000

  @doc "Starts the supervisor, unless it runs. It does not end with the calling process."
  @spec start() :: :ok
  def start do
    unless Process.whereis(__MODULE__) do
      {pid, ref} = spawn_monitor(&start_apart/0)
      receive do: ({:DOWN, ^ref, :process, ^pid, _reason} -> :ok)
    end

    :ok
  end

  # An application that ends kills all processes with its group leader, so this process gets the
  # group leader of the VM.
  defp start_apart do
    Process.group_leader(self(), Process.whereis(:init))

    with {:ok, pid} <- Supervisor.start_link(__MODULE__, [], name: __MODULE__),
         do: Process.unlink(pid)
  end

  @impl Supervisor
  def init(_opts) do
    Records.create()
    await_end(Process.whereis(Wardens))
    await_end(Process.whereis(HostWatch))

    children = [
      {DynamicSupervisor, [name: Wardens, strategy: :one_for_one] ++ @restarts},
      HostWatch,
      %{id: :resume, start: {Task, :start_link, [__MODULE__, :resume, []]}, restart: :transient}
    ]

    Supervisor.init(children, [strategy: :rest_for_one] ++ @restarts)
  end

  # An orphan of a killed predecessor still has its name, and may not end by itself.
  defp await_end(nil), do: :ok

  defp await_end(pid) do
    ref = Process.monitor(pid)

    receive do
      {:DOWN, ^ref, :process, ^pid, _reason} -> :ok
    after
      @patience_ms ->
        Process.exit(pid, :kill)
        receive do: ({:DOWN, ^ref, :process, ^pid, _reason} -> :ok)
    end
  end

  @doc "Starts a warden for each robot with a record."
  @spec resume() :: :ok
  def resume, do: Enum.each(Records.records(), &Wardens.resume/1)
end

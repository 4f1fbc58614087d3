defmodule BB.Safety.Supervisor do
  @moduledoc """
  The processes of `BB.Safety`, outside of all robots and of all applications:

      BB.Safety.Supervisor        rest_for_one
      ├── BB.Safety.Wardens       a BB.Safety.Warden for each robot
      ├── BB.Safety.Host          watches the application, whose end disarms all robots
      └── resume                  starts a warden again for each robot with a record, and ends

  No supervisor stands above it, so none can take it down: it is there from the first start of the
  application until the end of the VM. When it is killed, `BB.Safety.Anchor` starts it again,
  which stands in the application, and where that is gone too, `BB.Safety.Host`. Nothing here
  holds what it knows, so that nothing is lost with it (`BB.Safety.Records`).
  """

  use Supervisor

  alias BB.Safety.{Host, Records, Warden}

  # However often wardens are killed, the others stay.
  @restarts [max_restarts: 1_000, max_seconds: 1]

  # Longer than a supervisor gives its children to end.
  @patience_ms 6_000

  @doc "Starts safety, unless it runs. It does not end with the calling process."
  @spec start() :: :ok
  def start do
    unless Process.whereis(__MODULE__) do
      {pid, ref} = spawn_monitor(&start_apart/0)
      receive do: ({:DOWN, ^ref, :process, ^pid, _reason} -> :ok)
    end

    :ok
  end

  # An application that ends kills all processes of its group, so this one belongs to the group of
  # the VM.
  defp start_apart do
    Process.group_leader(self(), Process.whereis(:init))

    with {:ok, pid} <- Supervisor.start_link(__MODULE__, [], name: __MODULE__),
         do: Process.unlink(pid)
  end

  @impl Supervisor
  def init(_opts) do
    Records.create()
    await_end(Process.whereis(BB.Safety.Wardens))
    await_end(Process.whereis(Host))

    children = [
      {DynamicSupervisor, [name: BB.Safety.Wardens, strategy: :one_for_one] ++ @restarts},
      Host,
      %{id: :resume, start: {Task, :start_link, [__MODULE__, :resume, []]}, restart: :transient}
    ]

    Supervisor.init(children, [strategy: :rest_for_one] ++ @restarts)
  end

  # What a predecessor that was killed has left behind has the name still, and need not end by
  # itself.
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

  @doc "Starts the wardens of robots that have a record."
  @spec resume() :: :ok
  def resume, do: Enum.each(Records.records(), &Warden.resume/1)
end

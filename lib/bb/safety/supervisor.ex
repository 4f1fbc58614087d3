defmodule BB.Safety.Supervisor do
  @moduledoc """
  The processes of `BB.Safety`, outside of all robots:

      BB.Safety.Supervisor        rest_for_one
      ├── BB.Safety.Wardens       a BB.Safety.Warden for each robot
      └── resume                  starts a warden again for each robot with a record, and ends

  Nothing here holds what it knows, so that nothing is lost with it (`BB.Safety.Table`). The application that has this among its
  children calls `secure/0` in its `prep_stop/1`.
  """

  use Supervisor

  alias BB.Safety.{Table, Warden}

  # However often wardens are killed, the others stay.
  @restarts [max_restarts: 1_000, max_seconds: 1]

  @doc "Starts them."
  @spec start_link(keyword()) :: Supervisor.on_start()
  def start_link(_opts), do: Supervisor.start_link(__MODULE__, [], name: __MODULE__)

  @impl Supervisor
  def init(_opts) do
    Table.create()
    await_end(Process.whereis(BB.Safety.Wardens))

    children = [
      {DynamicSupervisor, [name: BB.Safety.Wardens, strategy: :one_for_one] ++ @restarts},
      %{id: :resume, start: {Task, :start_link, [__MODULE__, :resume, []]}, restart: :transient}
    ]

    Supervisor.init(children, [strategy: :rest_for_one] ++ @restarts)
  end

  @doc "Disarms all robots that are armed, at once, and waits for it. For the end of the application, and so of the machine."
  @spec secure() :: :ok
  def secure do
    for record <- Table.records(), {_pid, ref} = spawn_monitor(Warden, :secure, [record.robot]) do
      ref
    end
    |> Enum.each(fn ref -> receive do: ({:DOWN, ^ref, :process, _pid, _reason} -> :ok) end)
  end

  # What a predecessor that was killed has left behind has the name still.
  defp await_end(nil), do: :ok

  defp await_end(pid) do
    ref = Process.monitor(pid)
    receive do: ({:DOWN, ^ref, :process, ^pid, _reason} -> :ok)
  end

  @doc "Starts the wardens of robots that have a record."
  @spec resume() :: :ok
  def resume, do: Enum.each(Table.records(), &Warden.resume/1)
end

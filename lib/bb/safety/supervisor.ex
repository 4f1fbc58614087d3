defmodule BB.Safety.Supervisor do
  @moduledoc """
  The processes of `BB.Safety`, outside of all robots:

      BB.Safety.Supervisor        rest_for_one
      ├── BB.Safety.Wardens       a BB.Safety.Warden for each robot
      └── resume                  starts a warden again for each robot with a record; no process

  Nothing here holds what it knows, so that nothing is lost with it (`BB.Safety.Table`).
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

    children = [
      {DynamicSupervisor, [name: BB.Safety.Wardens, strategy: :one_for_one] ++ @restarts},
      %{id: :resume, start: {__MODULE__, :resume, []}}
    ]

    Supervisor.init(children, [strategy: :rest_for_one] ++ @restarts)
  end

  @doc "Starts the wardens of robots that have a record."
  @spec resume() :: :ignore
  def resume do
    Enum.each(Table.records(), &Warden.resume/1)
    :ignore
  end
end

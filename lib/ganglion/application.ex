defmodule Ganglion.Application do
  @moduledoc false
  use Application

  @impl Application
  def start(_type, _args) do
    # Here, so that the tables belong to the application's own process.
    BB.Safety.Table.create()
    children = [BB.Safety.Supervisor, {Registry, keys: :unique, name: BB.Bus.Sim.Registry}]
    Supervisor.start_link(children, strategy: :one_for_one, name: Ganglion.Supervisor)
  end

  @impl Application
  def prep_stop(state) do
    BB.Safety.Supervisor.secure()
    state
  end
end

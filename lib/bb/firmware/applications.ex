defmodule BB.Firmware.Applications do
  @moduledoc """
  Starts an application of a board again when it ends, and restarts the board when that does not
  help.

      config :shoehorn, handler: BB.Firmware.Applications

  Nerves' shoehorn starts all applications as temporary: one that ends stays ended, and the board
  runs on without it. Shoehorn tells this module of each end, as it tells any `Shoehorn.Handler`;
  what follows decides `BB.Firmware.Applications.RestartPolicy`, and does
  `BB.Firmware.Applications.Restarter`, a process outside all applications. An application that did
  not start is one that has ended, and one whose dependency has ended before it could start is
  started with it.

  What happened is told in the board's story (`BB.Firmware.Story`), which the console shows.

  Options of the restarter: `config :ganglion, BB.Firmware.Applications`.
  """

  alias BB.Firmware.Applications.Restarter

  # Shoehorn is there on boards alone, and there the compiler shall check what it wants.
  if Code.ensure_loaded?(Shoehorn.Handler), do: @behaviour(Shoehorn.Handler)

  @doc "Starts the restarter. Its options are the configured ones."
  @spec init(keyword()) :: {:ok, GenServer.server()}
  def init(_opts) do
    _ = restarter()
    {:ok, Restarter}
  end

  @doc "An application has started."
  @spec application_started(atom(), GenServer.server()) :: {:continue, GenServer.server()}
  def application_started(app, restarter), do: tell({:started, app}, restarter)

  @doc "An application has ended, or did not start."
  @spec application_exited(atom(), term(), GenServer.server()) :: {:continue, GenServer.server()}
  def application_exited(app, reason, restarter), do: tell({:ended, app, reason}, restarter)

  # It never asks to halt: that is no orderly end, and this module's limit of time is not
  # shoehorn's.
  defp tell(event, restarter) do
    _ = if restarter == Restarter, do: restarter()
    Restarter.tell(restarter, event)
    {:continue, restarter}
  end

  # It is linked to nobody, so that its end is nobody's; the next event starts it again.
  defp restarter do
    if Process.whereis(Restarter) == nil, do: Restarter.start([name: Restarter] ++ configured())
  end

  defp configured, do: Application.get_env(:ganglion, __MODULE__, [])
end

defmodule BB.Firmware.Applications do
  @moduledoc """
  Starts an application of a board again when it ends, and restarts the board when that does not
  help. Use it on boards, as the handler of Nerves' shoehorn:

      config :shoehorn, handler: BB.Firmware.Applications

  Shoehorn starts all applications as temporary: an application that ends is not started again,
  and the board keeps running without it. Shoehorn calls this module at each end, as it calls
  any `Shoehorn.Handler`. `BB.Firmware.Applications.RestartPolicy` decides what follows, and
  `BB.Firmware.Applications.Restarter`, a process outside of all applications, does it. An
  application that did not start counts as ended. An application whose dependency ended before
  it could start is started with its dependency.

  The board's story has a line for each event (`BB.Firmware.Story`), which the console shows.

  `config :ganglion, BB.Firmware.Applications` has the options of the restarter.
  """

  alias BB.Firmware.Applications.Restarter

  # Shoehorn exists on boards alone, where the compiler checks its callbacks.
  if Code.ensure_loaded?(Shoehorn.Handler), do: @behaviour(Shoehorn.Handler)

  @doc "Starts the restarter with the configured options."
  @spec init(keyword()) :: {:ok, GenServer.server()}
  def init(_opts) do
    _ = restarter()
    {:ok, Restarter}
  end

  @doc "Handles the start of an application."
  @spec application_started(atom(), GenServer.server()) :: {:continue, GenServer.server()}
  def application_started(app, restarter), do: handle_event({:started, app}, restarter)

  @doc "Handles the end, or the failed start, of an application."
  @spec application_exited(atom(), term(), GenServer.server()) :: {:continue, GenServer.server()}
  def application_exited(app, reason, restarter),
    do: handle_event({:ended, app, reason}, restarter)

  # It never returns :halt: that would be no orderly end, and shoehorn's time limit differs from
  # this module's.
  defp handle_event(event, restarter) do
    _ = if restarter == Restarter, do: restarter()
    Restarter.handle_event(restarter, event)
    {:continue, restarter}
  end

  # It has no links, so that its end affects no other process. The next event starts it again.
  defp restarter do
    if Process.whereis(Restarter) == nil, do: Restarter.start([name: Restarter] ++ configured())
  end

  defp configured, do: Application.get_env(:ganglion, __MODULE__, [])
end

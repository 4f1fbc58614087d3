defmodule BB.Sim.Controller do
  @moduledoc """
  The controller that stands for a controller with `simulation: :mock` in a simulated robot.

      controller :bus, {MyRobot.ServoBus, port: "ttyUSB0"}, simulation: :mock

  It answers each call with `:ok`, and ignores casts and messages.
  """

  use BB.Controller

  @impl BB.Controller
  def init(opts), do: {:ok, opts}

  @impl BB.Controller
  def handle_call(_request, _from, state), do: {:reply, :ok, state}
end

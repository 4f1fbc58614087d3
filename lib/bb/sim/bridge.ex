defmodule BB.Sim.Bridge do
  @moduledoc """
  The bridge that stands for a bridge with `simulation: :mock` in a simulated robot.

      bridge :registers, {MyRobot.Registers, port: "ttyUSB0"}, simulation: :mock

  It answers each call with `:ok`, and ignores casts and messages.
  """

  use BB.Bridge
  use BB.Process.Tolerant

  @impl GenServer
  def init(opts), do: {:ok, opts}

  @impl GenServer
  def handle_call(_request, _from, state), do: {:reply, :ok, state}

  @impl BB.Bridge
  def handle_change(_robot, _changed, state), do: {:ok, state}
end

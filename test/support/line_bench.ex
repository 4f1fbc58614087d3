defmodule BB.Test.LineBench do
  @moduledoc """
  Runs a driver without a robot on simulated lines, with a pubsub and a stepped clock of its own.

  Use it in a `setup`:

      setup do
        BB.Test.LineBench.start([])
      end
  """

  import ExUnit.Callbacks

  alias BB.Bus.Sim.Lines
  alias BB.Clock
  alias BB.Clock.Stepped

  @path [:base, :subject]

  @doc """
  Starts a stepped clock, a pubsub and a chip on that clock, and returns their names: `%{robot: r,
  chip: name}`.
  """
  def start(chip_options) do
    unique = System.unique_integer([:positive])
    robot = Module.concat(__MODULE__, "Robot#{unique}")
    chip = "gpiochip-bench-#{unique}"
    start_supervised!({Stepped, robot: robot})
    start_supervised!({BB.PubSub, robot})
    start_supervised!({Lines, chips: %{chip => [clock: Clock.of(robot)] ++ chip_options}})
    {:ok, _} = BB.PubSub.subscribe(robot, [:sensor])
    %{robot: robot, chip: chip}
  end

  @doc "Starts the driver: `{:ok, pid}` or its error."
  def run(%{robot: robot}, driver, options) do
    args = [__callback_module__: driver, bb: %{robot: robot, path: @path}] ++ options
    start_supervised(Supervisor.child_spec({BB.Sensor.Server, args}, restart: :temporary))
  end

  @doc "Starts the driver and returns its pid."
  def run!(bench, driver, options) do
    {:ok, pid} = run(bench, driver, options)
    pid
  end

  @doc "Advances the clock by seconds, until all messages are handled."
  def pass(%{robot: robot}, seconds, pid),
    do: Stepped.advance(robot, round(seconds * 1.0e9), settle: [pid])

  @doc "Returns the payloads that were published since the last call."
  def published do
    receive do
      {:bb, [:sensor | @path], %{payload: payload}} -> [payload | published()]
    after
      0 -> []
    end
  end
end

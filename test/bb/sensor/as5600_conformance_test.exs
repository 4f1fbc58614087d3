defmodule BB.Sensor.As5600ConformanceTest do
  # The chip has no identity.
  use BB.Sensor.Conformance,
    driver: {BB.Sensor.As5600, rate: 100},
    device: {BB.Bus.Sim.As5600, source: [angle: 1.0]},
    new_options: [rate: 50]
end

defmodule BB.Sensor.Ina219ConformanceTest do
  use BB.Sensor.Conformance,
    driver: {BB.Sensor.Ina219, rate: 10},
    device: {BB.Bus.Sim.Ina219, source: [voltage: 11.1, current: 1.5]},
    other_device: {BB.Bus.Sim.Ina219, reset_value: 0x4127},
    new_options: [rate: 50]
end

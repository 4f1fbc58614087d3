defmodule BB.Sensor.HcSr04ConformanceTest do
  use BB.Sensor.Conformance,
    driver: {BB.Sensor.HcSr04, &[trigger: {&1.chip, 23}, echo: {&1.chip, 24}]},
    device: {BB.Bus.Sim.HcSr04, pins: [trigger: 23, echo: 24]},
    new_options: [rate: 5]
end

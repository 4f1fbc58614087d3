defmodule BB.Sensor.TfLunaConformanceTest do
  use BB.Sensor.Conformance,
    driver: {BB.Sensor.TfLuna, rate: 50},
    device: {BB.Bus.Sim.TfLuna, source: [distance: 1.5]},
    other_device: {BB.Bus.Sim.TfLuna, signature: "MOON"},
    new_options: [rate: 20]
end

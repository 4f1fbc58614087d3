defmodule BB.Sensor.QuadratureEncoderConformanceTest do
  # A wheel at rest misses no edges, and noise on both lines looks like a turning wheel.
  use BB.Sensor.Conformance,
    driver:
      {BB.Sensor.QuadratureEncoder, &[a: {&1.chip, 5}, b: {&1.chip, 6}, pulses: 11, rate: 50]},
    device: {BB.Bus.Sim.Encoder, pins: [a: 5, b: 6], pulses: 11},
    new_options: [rate: 20],
    unseen: [:unplug, :cut, :short, :storm]
end

defmodule BB.Sensor.Mpu6050ConformanceTest do
  # A reset takes no time: the driver waits by the machine's clock, and stepped time may be behind
  # that on a busy machine.
  use BB.Sensor.Conformance,
    driver: {BB.Sensor.Mpu6050, rate: 100},
    device: {BB.Bus.Sim.Mpu6050, source: :motion, reset_ms: 0},
    other_device: {BB.Bus.Sim.Mpu6050, who_am_i: 0x33},
    new_options: [rate: 50]
end

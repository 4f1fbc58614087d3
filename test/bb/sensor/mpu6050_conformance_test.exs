defmodule BB.Sensor.Mpu6050ConformanceTest do
  use BB.Sensor.Conformance,
    driver: {BB.Sensor.Mpu6050, rate: 100},
    device: {BB.Bus.Sim.Mpu6050, source: :motion},
    other_device: {BB.Bus.Sim.Mpu6050, who_am_i: 0x33},
    new_options: [rate: 50]
end

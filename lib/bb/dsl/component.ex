defmodule BB.Dsl.Component do
  @moduledoc """
  The words that declare components: `sensor`, `actuator` and `controller`. A component has a name
  and runs as a process of its own.

      sensor :imu, {BB.Sensor.Mpu6050, bus: "i2c-1"}, max_silence: ~u(100 millisecond)
  """

  import BB.Dsl.Vocabulary, only: [entity: 5]

  @sensor [BB.Dsl.Words.Sensor]
  @actuator [BB.Dsl.Words.Actuator]
  @controller [BB.Dsl.Words.Controller]

  @doc """
  Declares a sensor: `sensor :imu, {BB.Sensor.Mpu6050, bus: "i2c-1"}`, or the module alone when
  it needs no options.

  Fields, as keywords or in a block:

    * `required` - whether the robot is useless without the sensor (`false`)
    * `retain` - whether the pubsub retains its last message for late subscribers (`false`)
    * `max_silence` - the longest time between two messages that the sensor publishes or carries
      elsewhere; a sensor that is silent for longer is `:stale`
    * `transmission` - the transmission between the sensor and its joint: `reduction`, `offset`,
      `reversed?`
  """
  defmacro sensor(name, child), do: entity(:sensor, [name, child], 2, @sensor, __CALLER__)

  defmacro sensor(name, child, fields),
    do: entity(:sensor, [name, child, fields], 2, @sensor, __CALLER__)

  defmacro sensor(name, child, fields, block),
    do: entity(:sensor, [name, child, fields, block], 2, @sensor, __CALLER__)

  @doc """
  Declares an actuator of a joint: `actuator :servo, {MyRobot.Servo, channel: 0}`.

  Fields, as keywords or in a block:

    * `required` - whether the robot is useless without the actuator (`false`)
    * `transmission` - the transmission between the actuator and its joint: `reduction`, `offset`,
      `reversed?`
  """
  defmacro actuator(name, child), do: entity(:actuator, [name, child], 2, @actuator, __CALLER__)

  defmacro actuator(name, child, fields),
    do: entity(:actuator, [name, child, fields], 2, @actuator, __CALLER__)

  defmacro actuator(name, child, fields, block),
    do: entity(:actuator, [name, child, fields, block], 2, @actuator, __CALLER__)

  @doc """
  Declares a controller in `controllers`.

      controller :balance, {MyRobot.Balance, gain: param([:balance, :gain])}

  Field: `required` - whether the robot is useless without the controller (`false`).
  """
  defmacro controller(name, child),
    do: entity(:controller, [name, child], 2, @controller, __CALLER__)

  defmacro controller(name, child, fields),
    do: entity(:controller, [name, child, fields], 2, @controller, __CALLER__)

  defmacro controller(name, child, fields, block),
    do: entity(:controller, [name, child, fields, block], 2, @controller, __CALLER__)
end

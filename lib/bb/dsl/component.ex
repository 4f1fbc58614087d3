defmodule BB.Dsl.Component do
  @moduledoc "The words that declare components: what runs as a process of its own and has a name."

  import BB.Dsl.Vocabulary, only: [entity: 5]

  @sensor [BB.Dsl.Words.Sensor]
  @actuator [BB.Dsl.Words.Actuator]
  @controller [BB.Dsl.Words.Controller]

  @doc """
  Declares a sensor: `sensor :imu, {BB.Sensor.Mpu6050, bus: "i2c-1"}`, or the module alone when it needs no options.

  Fields, as keywords or in a block:

    * `required` - whether the robot is of no use without it (`false`)
    * `retain` - whether its last message is worth keeping for those who subscribe late (`false`)
    * `max_silence` - the longest time between two of its messages, or of what it carries
      elsewhere; a sensor silent for longer is `:stale`
    * `transmission` - what is between it and the joint that it is attached to: `reduction`, `offset`, `reversed?`
  """
  defmacro sensor(name, child), do: entity(:sensor, [name, child], 2, @sensor, __CALLER__)

  defmacro sensor(name, child, fields),
    do: entity(:sensor, [name, child, fields], 2, @sensor, __CALLER__)

  defmacro sensor(name, child, fields, block),
    do: entity(:sensor, [name, child, fields, block], 2, @sensor, __CALLER__)

  @doc """
  Declares an actuator of a joint: `actuator :servo, {MyRobot.Servo, channel: 0}`.

  Inside, or as keywords: `required` - whether the robot is of no use without it (`false`), and `transmission`.
  """
  defmacro actuator(name, child), do: entity(:actuator, [name, child], 2, @actuator, __CALLER__)

  defmacro actuator(name, child, fields),
    do: entity(:actuator, [name, child, fields], 2, @actuator, __CALLER__)

  defmacro actuator(name, child, fields, block),
    do: entity(:actuator, [name, child, fields, block], 2, @actuator, __CALLER__)

  @doc """
  Declares a controller in `controllers`: `controller :balance, {MyRobot.Balance, gain: param([:balance, :gain])}`.

  Field: `required` - whether the robot is of no use without it (`false`).
  """
  defmacro controller(name, child),
    do: entity(:controller, [name, child], 2, @controller, __CALLER__)

  defmacro controller(name, child, fields),
    do: entity(:controller, [name, child, fields], 2, @controller, __CALLER__)

  defmacro controller(name, child, fields, block),
    do: entity(:controller, [name, child, fields, block], 2, @controller, __CALLER__)
end

defmodule BB.Dsl.Component do
  @moduledoc "The words that declare components: what runs as a process of its own and has a name."

  import BB.Dsl.Vocabulary, only: [entity: 5]

  @inside [BB.Dsl.Sensor]

  @doc """
  Declares a sensor: `sensor :imu, {BB.Sensor.Mpu6050, bus: "i2c-1"}`, or the module alone when it needs no options.

  Fields, as keywords or in a block:

    * `required` - whether the robot is of no use without it (`false`)
    * `retain` - whether its last message is worth keeping for those who subscribe late (`false`)
    * `max_silence` - the longest time between two of its messages; a sensor silent for longer is `:stale`
    * `transmission` - what is between it and the joint that it is attached to: `reduction`, `offset`, `reversed?`
  """
  defmacro sensor(name, child), do: entity(:sensor, [name, child], 2, @inside, __CALLER__)

  defmacro sensor(name, child, fields),
    do: entity(:sensor, [name, child, fields], 2, @inside, __CALLER__)

  defmacro sensor(name, child, fields, block),
    do: entity(:sensor, [name, child, fields, block], 2, @inside, __CALLER__)
end

defmodule BB.Dsl.Simulation do
  @moduledoc """
  The words inside `simulation`, which declare simulated buses and the devices on them.

      simulation do
        i2c "i2c-1", clock_hz: 400_000 do
          device 0x68, {BB.Bus.Sim.Mpu6050, source: :motion}
        end
      end
  """

  import BB.Dsl.Vocabulary, only: [entity: 5]

  @inside [BB.Dsl.Words.SimulatedBus]

  @doc """
  Declares a simulated I2C bus: `i2c "i2c-1", clock_hz: 400_000 do … end`.

  Field: `clock_hz` - the clock of the bus; without a clock transfers take no time
  (`t:BB.Bus.Sim.bus_options/0`).
  """
  defmacro i2c(name_or_block), do: entity(:i2c, [name_or_block], 1, @inside, __CALLER__)
  defmacro i2c(name, block), do: entity(:i2c, [name, block], 1, @inside, __CALLER__)

  defmacro i2c(name, fields, block),
    do: entity(:i2c, [name, fields, block], 1, @inside, __CALLER__)

  @doc """
  Declares a simulated chip of GPIO lines: `gpio "gpiochip0" do … end`.

  Fields: `lines` (54), `label`, `labels`, `timestamp_offset_ns`, as in
  `t:BB.Bus.Sim.Lines.chip_options/0`.
  """
  defmacro gpio(name_or_block), do: entity(:gpio, [name_or_block], 1, @inside, __CALLER__)
  defmacro gpio(name, block), do: entity(:gpio, [name, block], 1, @inside, __CALLER__)

  defmacro gpio(name, fields, block),
    do: entity(:gpio, [name, fields, block], 1, @inside, __CALLER__)
end

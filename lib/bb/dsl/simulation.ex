defmodule BB.Dsl.Simulation do
  @moduledoc "The words inside `simulation`, for the buses and what hangs on them."

  import BB.Dsl.Vocabulary, only: [entity: 5]

  @inside [BB.Dsl.Words.SimulatedBus]

  @doc """
  A simulated I2C bus, by its name: `i2c "i2c-1", clock_hz: 400_000 do … end`.

  Fields: `clock_hz` - its clock; without it transfers are instant (`t:BB.Bus.Sim.bus_options/0`).
  """
  defmacro i2c(name_or_block), do: entity(:i2c, [name_or_block], 1, @inside, __CALLER__)
  defmacro i2c(name, block), do: entity(:i2c, [name, block], 1, @inside, __CALLER__)

  defmacro i2c(name, fields, block),
    do: entity(:i2c, [name, fields, block], 1, @inside, __CALLER__)

  @doc """
  A simulated chip of GPIO lines, by its name: `gpio "gpiochip0" do … end`.

  Fields: `lines` (54), `label`, `labels`, `timestamp_offset_ns`, as in
  `t:BB.Bus.Sim.Lines.chip_options/0`.
  """
  defmacro gpio(name_or_block), do: entity(:gpio, [name_or_block], 1, @inside, __CALLER__)
  defmacro gpio(name, block), do: entity(:gpio, [name, block], 1, @inside, __CALLER__)

  defmacro gpio(name, fields, block),
    do: entity(:gpio, [name, fields, block], 1, @inside, __CALLER__)
end

defmodule BB.Test.Chaos.Wires do
  @moduledoc "Begins and ends the faults of `BB.Test.Chaos.Plan`."

  alias BB.Bus.Sim
  alias BB.Bus.Sim.Lines

  @doc "Begins a fault at a place."
  def break({:i2c, bus, _address}, :stuck), do: Sim.stuck(bus)
  def break({:i2c, bus, address}, :unplug), do: Sim.unplug(bus, address)
  def break({:i2c, bus, address}, fault), do: Sim.fault(bus, address, fault)
  def break({:gpio, chip, device, _lines}, :unplug), do: Lines.unplug(chip, device)
  def break({:gpio, chip, _device, [line | _]}, :cut_one), do: Lines.fault({chip, line}, :cut)

  def break({:gpio, chip, _device, lines}, fault),
    do: Enum.each(lines, &Lines.fault({chip, &1}, fault))

  @doc "Ends a fault."
  def mend({:i2c, bus, _address}, :stuck), do: Sim.release(bus)
  def mend({:i2c, bus, address}, :unplug), do: Sim.replug(bus, address)
  def mend({:i2c, bus, address}, _fault), do: Sim.clear(bus, address)
  def mend({:gpio, chip, device, _lines}, :unplug), do: Lines.replug(chip, device)
  def mend({:gpio, chip, _device, lines}, _fault), do: Enum.each(lines, &Lines.clear({chip, &1}))

  @doc """
  Returns how long the fault of one device holds its shared wires at each transfer, in
  milliseconds.
  """
  def holds_ms({:slow, _ms}), do: 20
  def holds_ms(:timeout), do: 20
  def holds_ms(_fault), do: 0
end

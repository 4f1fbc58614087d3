defmodule BB.Sensor.Conformance.I2C do
  @moduledoc """
  The wires of a chip on I2C: a simulated bus of its own for each test.

  `BB.Sensor.Conformance` uses it when the model of the chip does not define `pins/0`.
  """
  @moduledoc no_example: "internal: BB.Sensor.Conformance chooses the wires by the device's model"

  @behaviour BB.Sensor.Conformance.Wires

  alias BB.Bus.Sim

  @impl true
  def faults, do: [:unplug, :nak, :timeout, :stuck]

  @impl true
  def absence, do: :unplug

  @impl true
  def stuck, do: :stuck

  @impl true
  def deceptive, do: []

  @impl true
  def start(setting, name, clock) do
    place = %{bus: name, address: setting.address}

    {:ok, pid} =
      Sim.start_link(
        buses: %{name => [devices: %{setting.address => setting.device}, clock: clock]}
      )

    {pid, place}
  end

  @impl true
  def options(place), do: [bus: place.bus, address: place.address]

  @impl true
  def exchange(place, device) do
    :ok = Sim.unplug(place.bus, place.address)
    :ok = Sim.plug(place.bus, place.address, device)
  end

  @impl true
  def break(place, :unplug), do: Sim.unplug(place.bus, place.address)
  def break(place, :stuck), do: Sim.stuck(place.bus)
  def break(place, fault), do: Sim.fault(place.bus, place.address, fault)

  @impl true
  def mend(place, :unplug), do: Sim.replug(place.bus, place.address)
  def mend(place, :stuck), do: Sim.release(place.bus)
  def mend(place, _fault), do: Sim.clear(place.bus, place.address)

  @impl true
  def free?(place),
    do: not Enum.any?(BB.Bus.I2C.health(), &(&1.bus == place.bus and &1.handles > 0))
end

defmodule BB.Dsl.SimulatedBus do
  @moduledoc "The word inside a simulated bus or chip of lines."

  import BB.Dsl.Vocabulary, only: [entity: 5]

  @doc """
  A simulated device: on an I2C bus by its address, `device 0x68, {BB.Bus.Sim.Mpu6050, source: :motion}`
  (`BB.Bus.Sim.Device`); on lines by a name, `device :bumper, {BB.Bus.Sim.Contact, pins: [contact: 17]}`
  (`BB.Bus.Sim.GPIO.Device`).
  """
  defmacro device(place, model), do: entity(:device, [place, model], 2, [], __CALLER__)

  defmacro device(place, model, fields),
    do: entity(:device, [place, model, fields], 2, [], __CALLER__)
end

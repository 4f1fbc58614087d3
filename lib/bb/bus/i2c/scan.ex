defmodule BB.Bus.I2C.Scan do
  @moduledoc """
  Finds the devices on a bus, for every module with the interface of `Circuits.I2C`.

  `BB.Bus.I2C`, `BB.Bus.Linux.I2C` and `BB.Bus.Sim.I2C` have their `detect_devices/1` from here.
  """
  @moduledoc no_example: "internal: detect_devices/1 of the buses is its interface"

  # The addresses below and above are reserved.
  @addresses 0x03..0x77

  @doc "Returns whether memory chips have this address, which can take an empty write for a byte."
  defguard is_memory_chip(address) when address in 0x30..0x37 or address in 0x50..0x5F

  @doc """
  Returns the addresses at which a device answers, on an open bus of the module `i2c` or on the
  bus of a name.
  """
  @spec detect_devices(module(), struct() | String.t()) :: [0..127] | {:error, term()}
  def detect_devices(i2c, name) when is_binary(name) do
    with {:ok, bus} <- i2c.open(name) do
      found = detect_devices(i2c, bus)
      i2c.close(bus)
      found
    end
  end

  def detect_devices(i2c, bus), do: Enum.filter(@addresses, &i2c.device_present?(bus, &1))
end

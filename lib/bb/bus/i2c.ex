defmodule BB.Bus.I2C do
  @moduledoc """
  Which module stands for I2C here.

  On a board it is `Circuits.I2C`, on the host `BB.Bus.Sim.I2C`, which has the same functions, results and error atoms. That
  set of functions is the interface: a driver takes the module from here and calls it.

      i2c = BB.Bus.I2C.module(opts[:i2c])
      {:ok, bus} = i2c.open("i2c-1", timeout: 20)
      {:ok, <<0x68>>} = i2c.write_read(bus, 0x68, <<0x75>>, 1)
  """

  @doc "The module that was `given`, or else that of `config :ganglion, :i2c`, or else `Circuits.I2C`."
  @spec module(module() | nil) :: module()
  def module(nil), do: Application.get_env(:ganglion, :i2c, Circuits.I2C)
  def module(given) when is_atom(given), do: given
end

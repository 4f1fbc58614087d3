defmodule BB.Bus.Linux.Error do
  @moduledoc """
  Translates error numbers of the kernel into the errors of Circuits.

  `BB.Bus.Linux.I2C` and `BB.Bus.Linux.GPIO` use it.

      iex> BB.Bus.Linux.Error.i2c(121)
      :i2c_nak
      iex> BB.Bus.Linux.Error.gpio(16)
      :already_open
  """

  @eacces 13

  @i2c %{
    2 => :bus_not_found,
    6 => :enxio,
    11 => :retry,
    95 => :not_supported,
    110 => :timeout,
    121 => :i2c_nak
  }

  @gpio %{2 => :not_found, 16 => :already_open, 95 => :not_supported}

  @doc """
  Returns the error of an I2C bus: an atom for the errors that drivers match on, otherwise the
  number.

      iex> BB.Bus.Linux.Error.i2c(5)
      {:errno, 5}
  """
  @spec i2c(pos_integer()) :: atom() | {:errno, pos_integer()}
  def i2c(errno), do: Map.get(@i2c, errno, {:errno, errno})

  @doc """
  Returns the error of a line: Circuits' name for three of them, otherwise the system's name.

      iex> BB.Bus.Linux.Error.gpio(22)
      :einval
  """
  @spec gpio(pos_integer()) :: atom()
  def gpio(errno), do: Map.get_lazy(@gpio, errno, fn -> BB.Errno.name(errno) end)

  @doc "Returns whether an error of either means that there are no rights on the file."
  @spec no_rights?(term()) :: boolean()
  def no_rights?(error), do: error in [:eacces, {:errno, @eacces}]
end

defmodule BB.Bus.Linux.Error do
  @moduledoc """
  What Circuits calls the errors of the kernel. For `BB.Bus.Linux.I2C` and `BB.Bus.Linux.GPIO`.
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
  The error of an I2C bus: a word for what drivers look for, and the number for all else.

      iex> BB.Bus.Linux.Error.i2c(121)
      :i2c_nak
      iex> BB.Bus.Linux.Error.i2c(5)
      {:errno, 5}
  """
  @spec i2c(pos_integer()) :: atom() | {:errno, pos_integer()}
  def i2c(errno), do: Map.get(@i2c, errno, {:errno, errno})

  @doc """
  The error of a line: the system's own name, but for three of them.

      iex> BB.Bus.Linux.Error.gpio(16)
      :already_open
      iex> BB.Bus.Linux.Error.gpio(22)
      :einval
  """
  @spec gpio(pos_integer()) :: atom()
  def gpio(errno), do: Map.get_lazy(@gpio, errno, fn -> BB.Errno.name(errno) end)

  @doc "Whether an error of either says that the file may not be opened."
  @spec no_rights?(term()) :: boolean()
  def no_rights?(error), do: error in [:eacces, {:errno, @eacces}]
end

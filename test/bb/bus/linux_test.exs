defmodule BB.Bus.LinuxTest do
  use ExUnit.Case, async: true

  doctest BB.Bus.Linux
  doctest BB.Bus.Linux.Error
  doctest BB.Bus.Linux.GPIO
  doctest BB.Bus.Linux.Rights

  # The table of circuits_i2c 2.1 and circuits_gpio 2.3.
  test "the kernel's errors have Circuits' names" do
    alias BB.Bus.Linux.Error

    i2c = [
      {2, :bus_not_found},
      {6, :enxio},
      {11, :retry},
      {95, :not_supported},
      {110, :timeout},
      {121, :i2c_nak},
      {5, {:errno, 5}},
      {13, {:errno, 13}},
      {19, {:errno, 19}}
    ]

    for {errno, error} <- i2c, do: assert(Error.i2c(errno) == error)

    gpio = [
      {2, :not_found},
      {16, :already_open},
      {95, :not_supported},
      {9, :ebadf},
      {13, :eacces},
      {19, :enodev},
      {22, :einval},
      {25, :enotty}
    ]

    for {errno, error} <- gpio, do: assert(Error.gpio(errno) == error)
  end
end

defmodule BB.Bus.Sim.GPIO.ChipTest do
  use ExUnit.Case, async: true

  doctest BB.Bus.Sim.GPIO.Chip
end

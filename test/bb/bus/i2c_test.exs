defmodule BB.Bus.I2CTest do
  use ExUnit.Case, async: true

  test "a module that is given stands for I2C" do
    assert BB.Bus.I2C.module(Some.Bus) == Some.Bus
  end

  test "without one, the configured module does: on the host the simulated bus" do
    assert BB.Bus.I2C.module(nil) == BB.Bus.Sim.I2C
  end
end

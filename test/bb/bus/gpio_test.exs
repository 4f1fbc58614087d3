defmodule BB.Bus.GPIOTest do
  use ExUnit.Case, async: true

  test "the module that is given counts before the configured one" do
    assert BB.Bus.GPIO.module(Given) == Given
  end

  test "on the host it is the simulated one" do
    assert BB.Bus.GPIO.module(nil) == BB.Bus.Sim.GPIO
  end
end

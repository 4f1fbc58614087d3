defmodule BB.Bus.Sim.SampleTimesTest do
  use ExUnit.Case, async: true

  doctest BB.Bus.Sim.SampleTimes
end

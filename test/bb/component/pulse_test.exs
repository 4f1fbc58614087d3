defmodule BB.Component.PulseTest do
  use ExUnit.Case, async: true

  alias BB.Component.Pulse

  test "has the defaults until its process says more" do
    pulse = Pulse.new(nil)
    Pulse.adopt(pulse)

    assert {nil, 5_000, nil} =
             {Pulse.heard_ns(pulse), Pulse.shutdown_ms(pulse), Pulse.max_silence_ns()}

    :ok = Pulse.beat(-7)
    :ok = Pulse.shut_down_within(9_000)
    assert {-7, 9_000} = {Pulse.heard_ns(pulse), Pulse.shutdown_ms(pulse)}
  end

  test "tells the process how long it may be silent" do
    Pulse.adopt(Pulse.new(250_000_000))
    assert Pulse.max_silence_ns() == 250_000_000
  end

  test "is nothing to a process that has none" do
    assert :ok = Pulse.adopt(nil)
    assert :ok = Pulse.beat(1)
    assert :ok = Pulse.shut_down_within(1)
    assert Pulse.max_silence_ns() == nil
  end
end

defmodule BB.Component.HeartbeatTest do
  use ExUnit.Case, async: true

  alias BB.Component.Heartbeat

  doctest Heartbeat

  test "has the defaults until its process sets others" do
    heartbeat = Heartbeat.new(nil)
    Heartbeat.adopt(heartbeat)

    assert {nil, 5_000, nil} =
             {Heartbeat.last_ns(heartbeat), Heartbeat.shutdown_ms(heartbeat),
              Heartbeat.max_silence_ns()}

    :ok = Heartbeat.beat(-7)
    :ok = Heartbeat.shut_down_within(9_000)
    assert {-7, 9_000} = {Heartbeat.last_ns(heartbeat), Heartbeat.shutdown_ms(heartbeat)}
  end

  test "has the max_silence of the process" do
    Heartbeat.adopt(Heartbeat.new(250_000_000))
    assert Heartbeat.max_silence_ns() == 250_000_000
  end

  test "does nothing in a process that has none" do
    assert :ok = Heartbeat.adopt(nil)
    assert :ok = Heartbeat.beat(1)
    assert :ok = Heartbeat.shut_down_within(1)
    assert Heartbeat.max_silence_ns() == nil
  end
end

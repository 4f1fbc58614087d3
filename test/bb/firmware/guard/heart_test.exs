defmodule BB.Firmware.Guard.HeartTest do
  # The time of the end is one for the VM.
  use ExUnit.Case, async: false

  alias BB.Firmware.Guard.Heart

  doctest Heart

  test "the heart beats until the deadline and a minute" do
    on_exit(fn -> :persistent_term.erase(Heart) end)
    now_ms = System.monotonic_time(:millisecond)
    Heart.wind(now_ms - 50_000)
    assert Heart.check() == :ok
    Heart.wind(now_ms - 60_001)
    assert Heart.check() == :error
  end
end

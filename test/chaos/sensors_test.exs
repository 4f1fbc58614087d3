defmodule BB.Test.ChaosSensorsTest do
  @moduledoc "The judge of `bin/chaos sensors` finds what it looks for."

  use ExUnit.Case, async: true

  alias BB.Test.Chaos.{Plan, Verdict}

  doctest Plan
  doctest Verdict

  @ms 1_000_000
  @places %{
    imu: {:i2c, "i2c-1", 0x68},
    battery: {:i2c, "i2c-1", 0x40},
    elbow: {:i2c, "i2c-2", 0x36}
  }

  # A strike at 1000 ms that showed, and ended at 1500 ms.
  defp record(fault, changes \\ []) do
    Map.merge(
      %{
        strike: %{place: @places.imu, fault: fault, sensors: [:imu]},
        began_ns: 1_000 * @ms,
        shown_ns: 1_030 * @ms,
        ended_ns: 1_500 * @ms,
        up_ns: 2_000 * @ms,
        heard_ns: 2_010 * @ms
      },
      Map.new(changes)
    )
  end

  defp gaps(sensor, from_ms, to_ms, records, standstills \\ []) do
    intervals = %{sensor => [{from_ms * @ms, to_ms * @ms}]}
    rows = for name <- Map.keys(@places), do: %{name: name, declared_hz: 100}
    Verdict.gaps(intervals, records, standstills, @places, rows)
  end

  test "a fault that health never showed is hidden" do
    silent = record(:nak, shown_ns: nil)
    assert Verdict.hidden([record(:nak), silent]) == [silent]
  end

  test "a sensor that is up after more than a second, or never, has not recovered" do
    late = record(:nak, up_ns: 2_501 * @ms)
    never = record(:nak, up_ns: nil)
    assert Verdict.not_recovered([record(:nak), late, never], []) == [late, never]
  end

  test "time in which the VM stood still is taken off a recovery" do
    late = record(:nak, up_ns: 2_600 * @ms)
    assert Verdict.not_recovered([late], [{2_000 * @ms, 2_150 * @ms}]) == []
    assert Verdict.not_recovered([late], [{2_650 * @ms, 2_850 * @ms}]) == [late]
  end

  test "an interval of a sensor that nothing struck is a gap" do
    assert [{:elbow, _, _}] = gaps(:elbow, 1_100, 1_150, [record(:timeout)])
    assert gaps(:elbow, 1_100, 1_130, [record(:timeout)]) == []
  end

  test "an interval of one that was struck is none while that lasts, and until it publishes again" do
    assert gaps(:imu, 990, 2_010, [record(:nak)]) == []
    assert [{:imu, _, _}] = gaps(:imu, 2_100, 2_200, [record(:nak)])
  end

  test "one transfer of a device that holds the bus is taken off the intervals of those who share it" do
    assert gaps(:battery, 1_100, 1_150, [record(:timeout)]) == []
    assert [{:battery, _, _}] = gaps(:battery, 1_100, 1_160, [record(:timeout)])
    assert [{:battery, _, _}] = gaps(:battery, 1_100, 1_150, [record(:nak)])
  end

  test "time in which the VM stood still is taken off an interval" do
    assert gaps(:elbow, 1_100, 1_150, [], [{1_110 * @ms, 1_140 * @ms}]) == []
  end
end

defmodule BB.Component.ShutdownLimitTest do
  use ExUnit.Case, async: true

  alias BB.Component.ShutdownLimit

  defmodule Robot do
    @moduledoc false
  end

  setup do
    start_supervised!(BB.Process.registry_spec(Robot))
    :ok
  end

  test "a component has its own limit while no other was late" do
    assert ShutdownLimit.limit_ms(Robot, 5_000) == 5_000
    ShutdownLimit.record(Robot, :noproc)
    ShutdownLimit.record(Robot, {:normal, {GenServer, :stop, []}})
    assert ShutdownLimit.limit_ms(Robot, 5_000) == 5_000
  end

  test "after one that was late each has a second, or the limit that it has set" do
    ShutdownLimit.record(Robot, {:timeout, {GenServer, :stop, []}})
    assert ShutdownLimit.limit_ms(Robot, 5_000) == 1_000
    assert ShutdownLimit.limit_ms(Robot, 200) == 200
    assert ShutdownLimit.limit_ms(Robot, 12_000) == 12_000
  end

  test "without a registry each has its own limit" do
    :ok = stop_supervised(BB.Process.registry_name(Robot))
    ShutdownLimit.record(Robot, :timeout)
    assert ShutdownLimit.limit_ms(Robot, 5_000) == 5_000
  end
end

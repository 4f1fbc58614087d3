defmodule BB.Component.FarewellTest do
  use ExUnit.Case, async: true

  alias BB.Component.Farewell

  defmodule Robot do
    @moduledoc false
  end

  setup do
    start_supervised!(BB.Process.registry_spec(Robot))
    :ok
  end

  test "a component has its own time, as long as no other was late" do
    assert Farewell.limit_ms(Robot, 5_000) == 5_000
    Farewell.ended(Robot, :noproc)
    Farewell.ended(Robot, {:normal, {GenServer, :stop, []}})
    assert Farewell.limit_ms(Robot, 5_000) == 5_000
  end

  test "after one that was late each has a second, or what it has said itself" do
    Farewell.ended(Robot, {:timeout, {GenServer, :stop, []}})
    assert Farewell.limit_ms(Robot, 5_000) == 1_000
    assert Farewell.limit_ms(Robot, 200) == 200
    assert Farewell.limit_ms(Robot, 12_000) == 12_000
  end

  test "without a registry each has its own time" do
    :ok = stop_supervised(BB.Process.registry_name(Robot))
    Farewell.ended(Robot, :timeout)
    assert Farewell.limit_ms(Robot, 5_000) == 5_000
  end
end

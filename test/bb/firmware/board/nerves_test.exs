defmodule BB.Firmware.Board.NervesTest do
  @moduledoc "The board's module against processes that behave as Nerves' do, slow ones too."

  # The modules of Nerves are the VM's.
  use ExUnit.Case, async: false

  alias BB.Firmware.Board
  alias BB.Test.Nerves

  @moduletag :capture_log
  @board {Board.Nerves, []}

  setup do
    on_exit(fn -> Nerves.stop() end)
  end

  test "a first run of fwup that is late ends nothing: what is asked after it is answered" do
    {:ok, supervisor} = Nerves.start([1_200, 900, 0])
    kv = Process.whereis(Elixir.Nerves.Runtime.KV)
    assert Board.ready(@board) == :ok
    assert Process.whereis(Elixir.Nerves.Runtime.KV) == kv
    assert Process.alive?(supervisor)
    assert Board.firmware(@board) == %{"nerves_fw_uuid" => "new", "nerves_fw_version" => "2.0.0"}
    assert Board.other(@board) == %{"nerves_fw_uuid" => "old", "nerves_fw_version" => "1.0.0"}
    assert Board.slot(@board) == "b"
    assert Board.provisioned(@board) == %{"name" => "ada"}
  end

  test "without waiting for it the store ends, which is an error here" do
    Process.flag(:trap_exit, true)
    {:ok, _} = Nerves.start([1_200, 1_200, 0])
    kv = Process.whereis(Elixir.Nerves.Runtime.KV)
    ref = Process.monitor(kv)
    assert Board.firmware(@board) == %{}
    assert_receive {:DOWN, ^ref, :process, ^kv, {:timeout, _}}, 30_000
    assert Board.slot(@board) == nil
  end

  test "a revert that is late is waited for, and not asked for twice" do
    {:ok, _} = Nerves.start([1_200, 0])
    assert Board.revert(@board) == :ok
    assert_received {:fwup, "revert"}
    refute_received {:fwup, _}
    assert Board.prevent_revert(@board) == :ok
    assert_received {:fwup, "prevent-revert"}
  end

  test "without any process of Nerves each question has an answer" do
    assert {:error, _} = Board.ready(@board)
    assert {:error, :nerves_runtime_is_down} = Board.validation_status(@board)
    assert Board.firmware(@board) == %{}
    assert Board.other(@board) == %{}
    assert Board.slot(@board) == nil

    for call <- [&Board.revert/1, &Board.prevent_revert/1, &Board.validate/1, &Board.reboot/1],
        do: assert({:error, _} = call.(@board))
  end
end

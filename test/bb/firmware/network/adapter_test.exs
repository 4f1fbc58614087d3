defmodule BB.Firmware.Network.AdapterTest do
  use ExUnit.Case, async: true

  alias BB.Firmware.Network.{Adapter, None}

  doctest Adapter
  doctest None

  test "without a network of its own the state is unknown, and reaches nowhere" do
    assert Adapter.subscribe({None, []}) == :unknown
    assert Adapter.change({None, []}, :anything) == :error
    refute Adapter.reaches?(:unknown, :lan)
  end

  test "VintageNet's messages about the connection are changes, others are not" do
    source = {BB.Firmware.Network.VintageNet, []}
    message = &{VintageNet, &1, :disconnected, &2, %{}}
    assert Adapter.change(source, message.(["connection"], :lan)) == {:ok, :lan}
    assert Adapter.change(source, message.(["connection"], nil)) == {:ok, :disconnected}
    assert Adapter.change(source, message.(["interface", "eth0", "connection"], :lan)) == :error
  end
end

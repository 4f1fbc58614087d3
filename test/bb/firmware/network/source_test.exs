defmodule BB.Firmware.Network.SourceTest do
  use ExUnit.Case, async: true

  alias BB.Firmware.Network.{None, Source}

  doctest Source

  test "without a network of its own the state is unknown, and reaches nowhere" do
    assert Source.subscribe({None, []}) == :unknown
    assert Source.change({None, []}, :anything) == :error
    refute Source.reaches?(:unknown, :lan)
  end

  test "VintageNet's messages about the connection are changes, others are not" do
    source = {BB.Firmware.Network.VintageNet, []}
    message = &{VintageNet, &1, :disconnected, &2, %{}}
    assert Source.change(source, message.(["connection"], :lan)) == {:ok, :lan}
    assert Source.change(source, message.(["connection"], nil)) == {:ok, :disconnected}
    assert Source.change(source, message.(["interface", "eth0", "connection"], :lan)) == :error
  end
end

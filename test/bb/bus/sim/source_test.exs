defmodule BB.Bus.Sim.SourceTest do
  use ExUnit.Case, async: true

  alias BB.Bus.Sim.Source

  doctest BB.Bus.Sim.Source

  test "quantities that are not given are those by default" do
    assert [b: 3] |> Source.new(%{a: 1, b: 2}) |> Source.at(0) == %{a: 1, b: 3}
    assert %{} |> Source.new(%{a: 1}) |> Source.at(9.5) == %{a: 1}
  end

  test "an unknown quantity raises with the names of the known ones" do
    message = "expected a source of :a, :b, got: {:c, 3}"
    assert_raise ArgumentError, message, fn -> Source.new([c: 3], %{a: 1, b: 2}) end
    assert_raise ArgumentError, ~r/got: :motion/, fn -> Source.new(:motion, %{a: 1}) end
  end
end

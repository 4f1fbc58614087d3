defmodule BB.PathTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  alias BB.Path

  doctest BB.Path

  defp path, do: list(atom())

  test "segments are atoms and references" do
    assert Path.valid?([:sensor, make_ref()])
    assert Path.validate!([]) == []

    for wrong <- ["sensor", ["sensor"], [1], [:sensor | :imu], nil] do
      assert_raise ArgumentError, ~r/list of atoms.*got: #{Regex.escape(inspect(wrong))}/, fn ->
        Path.validate!(wrong)
      end
    end
  end

  test "nothing is above the root" do
    assert Path.ancestors([]) == []
  end

  property "the ancestors of a path are its proper prefixes, longest first" do
    forall path <- path() do
      Path.ancestors(path) == for(n <- (length(path) - 1)..0//-1, do: Enum.take(path, n))
    end
  end

  property "a path is below each of its ancestors and itself, and not below others" do
    forall {path, other} <- {path(), path()} do
      Path.prefix?(other, path) == other in [path | Path.ancestors(path)]
    end
  end
end

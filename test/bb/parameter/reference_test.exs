defmodule BB.Parameter.ReferenceTest do
  use ExUnit.Case, async: true

  import BB.Parameter.Reference

  alias BB.Parameter.Reference

  doctest BB.Parameter.Reference

  test "a reference has a path, and no unit yet" do
    assert param([:motion, :speed]) == %Reference{
             path: [:motion, :speed],
             expected_unit_type: nil
           }
  end

  test "a path is a list of at least one atom" do
    for path <- [[], :rate, "rate", nil, ["rate"], [:imu | :rate]],
        do: assert_raise(FunctionClauseError, fn -> param(path) end)

    assert_raise ArgumentError,
                 ~r/^expected the path of a parameter, .*got: param\(\[:a, 1\]/,
                 fn ->
                   param([:a, 1])
                 end
  end
end

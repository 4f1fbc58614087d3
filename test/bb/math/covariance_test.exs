defmodule BB.Math.CovarianceTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  import BB.Test.Math, only: [close?: 2, coordinate: 0, quaternion: 0]

  alias BB.Math.{Covariance3, Covariance6, Quaternion}

  doctest BB.Math.Covariance3
  doctest BB.Math.Covariance6

  defp covariance3, do: map(vector(9, coordinate()), &Covariance3.new/1)

  test "they have 9 and 36 elements" do
    assert_raise ArgumentError, ~r/expected a list of 9 numbers, got: \[1\]/, fn ->
      Covariance3.new([1])
    end

    assert_raise ArgumentError, ~r/expected a list of 36 numbers, got: \[1\]/, fn ->
      Covariance6.new([1])
    end
  end

  test "elements are found by row and column" do
    assert Covariance3.get(Covariance3.new(Enum.to_list(0..8)), 1, 2) === 5.0
    assert Covariance6.get(Covariance6.new(Enum.to_list(0..35)), 1, 2) === 8.0
    assert Covariance3.at(Covariance3.identity(), 1, 1) === 1.0
    assert Covariance6.at(Covariance6.identity(), 5, 5) === 1.0

    for {row, column} <- [{-1, 0}, {0, -1}, {3, 0}, {0, 3}, {1.0, 0}] do
      assert_raise FunctionClauseError, fn -> Covariance3.get(Covariance3.zero(), row, column) end
    end

    for {row, column} <- [{-1, 0}, {0, -1}, {6, 0}, {0, 6}, {1.0, 0}] do
      assert_raise FunctionClauseError, fn -> Covariance6.get(Covariance6.zero(), row, column) end
    end
  end

  test "rows are taken too" do
    rows = Enum.chunk_every(0..35, 6)
    assert Covariance6.new(rows) == Covariance6.new(Enum.to_list(0..35))
    assert_raise ArgumentError, ~r/six rows of 6 numbers/, fn -> Covariance6.new(tl(rows)) end
    assert_raise ArgumentError, ~r/six rows/, fn -> Covariance6.new([[1] | tl(rows)]) end
    assert_raise ArgumentError, ~r/9 numbers/, fn -> Covariance3.new([[1, 2, 3], [1, 2, 3]]) end
  end

  test "a diagonal has three or six variances" do
    assert Covariance3.diagonal([1, 2, 3]) == Covariance3.diagonal(1, 2, 3)
    assert Covariance3.get(Covariance3.diagonal([1, 2, 3]), 2, 2) === 3.0
    assert Covariance6.get(Covariance6.diagonal([1, 2, 3, 4, 5, 6]), 5, 5) === 6.0
    assert_raise ArgumentError, ~r/a list of 3 numbers/, fn -> Covariance3.diagonal([1, 2]) end
    assert_raise ArgumentError, ~r/a list of 6 numbers/, fn -> Covariance6.diagonal([1, 2]) end
  end

  property "the parts of a Covariance6 come out as they went in" do
    forall {linear, angular} <- {covariance3(), covariance3()} do
      whole = Covariance6.from_parts(linear, angular)

      Covariance6.linear(whole) == linear and Covariance6.angular(whole) == angular and
        Covariance6.at(whole, 0, 3) == 0.0
    end
  end

  property "turned variances keep their sum, and turn back" do
    forall {a, b, c, q} <- {coordinate(), coordinate(), coordinate(), quaternion()} do
      covariance = Covariance3.diagonal(a, b, c)
      turned = Covariance3.rotate(covariance, q)
      back = Covariance3.rotate(turned, Quaternion.inverse(q))
      trace = fn m -> Enum.sum(for i <- 0..2, do: Covariance3.at(m, i, i)) end

      abs(trace.(turned) - trace.(covariance)) < 1.0e-9 and
        Enum.zip(Covariance3.to_list(back), Covariance3.to_list(covariance))
        |> Enum.all?(fn {x, y} -> abs(x - y) < 1.0e-9 end) and
        close?(Covariance3.at(turned, 0, 1), Covariance3.at(turned, 1, 0))
    end
  end
end

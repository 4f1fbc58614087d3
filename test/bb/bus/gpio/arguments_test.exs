defmodule BB.Bus.GPIO.ArgumentsTest do
  use ExUnit.Case, async: true

  alias BB.Bus.GPIO.Arguments

  doctest BB.Bus.GPIO.Arguments

  test "the initial value of Circuits 1 is 0" do
    assert Arguments.options!(initial_value: :not_set)[:initial_value] == 0
  end

  test "a group is different lines of one chip" do
    lines = [{:ok, {"gpiochip0", 5}}, {:ok, {"gpiochip0", 6}}]
    assert Arguments.one_chip(lines) == {:ok, "gpiochip0", [5, 6]}
    assert Arguments.one_chip(lines ++ [{:error, :not_found}]) == {:error, :not_found}
    assert Arguments.one_chip(lines ++ lines) == {:error, :duplicate_lines}
  end
end

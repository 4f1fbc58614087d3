defmodule BB.Command.GoalTest do
  use ExUnit.Case, async: true

  alias BB.Command.Goal
  alias BB.Dsl.Command.Argument
  alias BB.Robot.Runtime

  doctest Goal
  doctest BB.Robot.Runtime

  defp coerced(type, value),
    do: Runtime.coerce_goal(%{it: value}, [%Argument{name: :it, type: type}]).it

  test "strings become values of the argument's type" do
    assert coerced(:integer, "12") === 12
    assert coerced(:float, "1.5") === 1.5
    assert coerced(:float, "-2") === -2.0
    assert coerced(:boolean, "true") == true
    assert coerced(:boolean, "false") == false
    assert coerced(:atom, "slow") == :slow
    assert coerced({:in, [:slow, :fast]}, "fast") == :fast
    assert coerced({:in, [1, 2.5, "three"]}, "1") === 1
    assert coerced({:in, [1, 2.5, "three"]}, "2.5") === 2.5
    assert coerced({:in, [1, 2.5, "three"]}, "three") == "three"
    assert coerced(:string, "12") == "12"
  end

  test "strings that cannot be parsed do not change" do
    assert coerced(:integer, "1.5") == "1.5"
    assert coerced(:integer, "") == ""
    assert coerced(:float, "fast") == "fast"
    assert coerced(:float, "1.5m") == "1.5m"
    assert coerced(:boolean, "yes") == "yes"
    assert coerced({:in, [:slow, {1, 2}]}, "fast") == "fast"
  end

  test "no atom is made" do
    name = "no_atom_#{System.unique_integer([:positive])}"
    assert coerced(:atom, name) == name
    assert_raise ArgumentError, fn -> String.to_existing_atom(name) end
  end

  test "values that are no strings do not change" do
    assert coerced(:float, 1) === 1
    assert coerced(:atom, nil) == nil
    assert coerced(:boolean, :yes) == :yes
  end

  test "defaults are filled in, and other keys are kept" do
    arguments = [
      %Argument{name: :speed, type: :float, default: 0.5},
      %Argument{name: :loud, type: :boolean, default: false},
      %Argument{name: :place, type: :atom}
    ]

    assert Runtime.coerce_goal([speed: "2.0", more: "1"], arguments) ==
             %{speed: 2.0, loud: false, more: "1"}

    assert Runtime.coerce_goal(%{"speed" => "2.0"}, arguments) ==
             %{"speed" => "2.0", speed: 0.5, loud: false}

    assert Runtime.coerce_goal(%{}, []) == %{}
  end
end

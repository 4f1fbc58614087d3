defmodule BB.Parameter.TypeTest do
  use ExUnit.Case, async: true

  import BB.Unit, only: :sigils

  alias BB.Parameter.Type

  doctest BB.Parameter.Type

  defp cast(type, value, bounds \\ []), do: Type.cast(type, bounds[:min], bounds[:max], value, :k)

  test "the types are :float :integer :boolean :string :atom {:unit, u}, {:in, _}, {:or, _} and {:list, _}" do
    for {type, good, bad} <- [
          {:float, 1.0, 1},
          {:integer, 1, 1.0},
          {:boolean, true, :yes},
          {:string, "a", :a},
          {:atom, :a, "a"},
          {{:unit, :hertz}, ~u(1 hertz), 1},
          {{:in, [:slow, :fast]}, :slow, :medium},
          {{:in, 1..10}, 10, 11},
          {{:or, [:integer, {:unit, :meter}]}, ~u(1 meter), "1"},
          {{:list, {:or, [:atom, :string]}}, [:a, "b"], [:a, 1]}
        ] do
      assert Type.check(type) == :ok
      assert cast(type, good) == {:ok, good}
      assert {:error, message} = cast(type, bad)
      assert message =~ ":k option"
    end
  end

  test "anything else is no type" do
    for type <- [
          :flaot,
          :any,
          nil,
          {:in, []},
          {:or, []},
          {:list, :x},
          {:unit, :metre},
          {:unit, 1}
        ] do
      assert {:error, reason} = Type.check(type)
      assert is_binary(reason)
    end
  end

  test "a value of a unit is kept in the parameter's own, also inside a list" do
    assert cast({:unit, :radian}, ~u(180 degree)) == {:ok, BB.Unit.new!(:math.pi(), :radian)}
    assert cast({:list, {:unit, :meter}}, [~u(1 kilometer)]) == {:ok, [~u(1000 meter)]}

    assert cast({:unit, :hertz}, ~u(1 meter)) ==
             {:error,
              "invalid value for :k option: cannot convert 1 meter to hertz: 1 meter is a length, hertz is a frequency"}

    assert cast({:unit, :hertz}, 100) ==
             {:error,
              "invalid value for :k option: expected a quantity such as ~u(1 hertz), got: 100"}
  end

  test "bounds are inclusive, and hold for each element of a list" do
    assert cast(:integer, 1, min: 1, max: 1) == {:ok, 1}
    assert {:error, _} = cast(:integer, 0, min: 1)
    assert {:error, _} = cast(:float, 1.5, max: 1)
    assert cast({:unit, :meter}, ~u(100 centimeter), max: ~u(1 meter)) == {:ok, ~u(1 meter)}
    assert {:error, message} = cast({:unit, :meter}, ~u(101 centimeter), max: ~u(1 meter))

    assert message ==
             "invalid value for :k option: expected at most ~u(1 meter), got: ~u(1.01 meter)"

    assert cast({:list, :integer}, [1, 2], min: 1) == {:ok, [1, 2]}
    assert {:error, _} = cast({:list, :integer}, [1, 0], min: 1)
  end
end

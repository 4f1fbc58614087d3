defmodule BB.Component.OptionsSchemaTest do
  use ExUnit.Case, async: true

  alias BB.Component.OptionsSchema
  alias BB.Options.ValidationError

  doctest OptionsSchema

  test "checks a module's own options, and fills in defaults" do
    assert OptionsSchema.validate(BB.Test.Probe, [], []) == {:ok, [rate: 100]}

    assert {:error, %ValidationError{key: :rate}} =
             OptionsSchema.validate(BB.Test.Probe, [rate: 0], [])
  end

  test "leaves the framework's keys as they are" do
    given = [bb: %{robot: R, path: [:a]}, sensor_profile: :anything, rate: 3]
    assert {:ok, options} = OptionsSchema.validate(BB.Test.Probe, given, [:bb, :sensor_profile])
    assert Enum.sort(options) == Enum.sort(given)

    assert {:error, %ValidationError{}} = OptionsSchema.validate(BB.Test.Probe, given, [:bb])
  end

  test "a module without a schema takes no option" do
    assert OptionsSchema.validate(String, [], []) == {:ok, []}
    assert {:error, %ValidationError{}} = OptionsSchema.validate(String, [a: 1], [])
  end
end

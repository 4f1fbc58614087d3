defmodule BB.Message.OptionTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  alias BB.Math.{Covariance3, Covariance6, Quaternion, Transform, Transform2D, Vec3}
  alias BB.Message.Geometry.{Twist, Twist2D, Wrench, Wrench2D}
  alias BB.Message.Option

  doctest BB.Message.Option

  defmodule Gust do
    import BB.Message.Option

    defstruct [:velocity, strengths: []]

    use BB.Message,
      schema: [
        velocity: [type: vec3_type(), required: true],
        strengths: [type: efforts_type(), default: []]
      ]
  end

  @structs [
    vec3: Vec3.zero(),
    quaternion: Quaternion.identity(),
    transform: Transform.identity(),
    covariance3: Covariance3.zero(),
    covariance6: Covariance6.zero()
  ]

  for {name, struct} <- @structs do
    test "#{name}_type takes its struct alone" do
      name = unquote(name)
      struct = unquote(Macro.escape(struct))
      {:custom, Option, function, args} = apply(Option, :"#{name}_type", [])
      assert {function, args} == {:"validate_#{name}", [[]]}
      assert apply(Option, function, [struct, []]) == {:ok, struct}

      for other <- [nil, 1.0, [], Map.from_struct(struct), %Twist{}] do
        assert apply(Option, function, [other, []]) ==
                 {:error, "expected a #{inspect(struct.__struct__)}, got: #{inspect(other)}"}
      end
    end
  end

  @lists [
    configurations: [%Transform2D{x: 0.0, y: 0.0, theta: 0.0}, Transform.identity()],
    velocities: [%Twist2D{vx: 1.0, vy: 0.0, omega: 0.0}, %Twist{}],
    efforts: [%Wrench2D{fx: 1.0, fy: 0.0, tau: 0.0}, %Wrench{}]
  ]

  for {name, [planar, floating]} <- @lists do
    test "#{name}_type takes floats and the structs of planar and floating joints" do
      name = unquote(name)
      [planar, floating] = unquote(Macro.escape([planar, floating]))
      {:custom, Option, function, args} = apply(Option, :"#{name}_type", [])
      assert {function, args} == {:"validate_#{name}", [[]]}
      check = &apply(Option, function, [&1, []])

      for list <- [[], [1.0, -0.5], [planar, 1.0, floating]],
          do: assert(check.(list) == {:ok, list})

      expected =
        "a float, #{inspect(planar.__struct__)}.t() or #{inspect(floating.__struct__)}.t()"

      for {list, n, wrong} <- [
            {[:nope], 0, :nope},
            {[1.0, 1], 1, 1},
            {[1.0, planar, nil, 2], 2, nil},
            {[Vec3.zero()], 0, Vec3.zero()}
          ],
          do:
            assert(
              check.(list) ==
                {:error, "expected element #{n} to be #{expected}, got: #{inspect(wrong)}"}
            )

      for other <- [nil, 1.0, %{}, [1.0 | 2.0]] do
        assert {:error, "expected a list, each element " <> rest} = check.(other)
        assert rest == "#{expected}, got: #{inspect(other)}"
      end
    end
  end

  test "a payload of a user has such fields" do
    assert {:ok, message} = Gust.new(:roof, velocity: Vec3.unit_x(), strengths: [2.0])
    assert message.payload == %Gust{velocity: Vec3.unit_x(), strengths: [2.0]}
    assert {:error, error} = Gust.new(:roof, velocity: Vec3.unit_x(), strengths: [2])

    assert Exception.message(error) ==
             "invalid value for :strengths option: expected element 0 to be a float, " <>
               "BB.Message.Geometry.Wrench2D.t() or BB.Message.Geometry.Wrench.t(), got: 2"

    assert {:error, %{key: :velocity}} = Gust.new(:roof, velocity: {1.0, 0.0, 0.0})
  end

  property "the first wrong element is the one that is named" do
    forall {good, wrong, rest} <- {list(float()), oneof([integer(), atom()]), list(float())} do
      {:error, message} = Option.validate_velocities(good ++ [wrong | rest], [])
      String.starts_with?(message, "expected element #{length(good)} to be a float, ")
    end
  end
end

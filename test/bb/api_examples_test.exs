defmodule BB.ApiExamplesTest do
  @moduledoc """
  Values and texts that code for Beam Bots expects, where the test of the module has other ones.
  """

  use ExUnit.Case, async: true

  import BB.Test.Mistake

  alias BB.Error.{Invalid, Kinematics, State}
  alias BB.Math.{Quaternion, Transform, Vec3}
  alias BB.Transmission.Resolver

  @half_pi :math.pi() / 2

  describe "a rotation" do
    test "of x, y and z by 0.1, 0.2 and 0.3 rad" do
      rotation = Quaternion.from_euler(0.1, 0.2, 0.3)
      assert_near(rotation, [0.981856173, 0.064071348, 0.091157549, 0.153439302])
      other = Quaternion.from_euler(0.1, 0.2, 0.3, :zyx)
      assert_near(other, [0.983347443, 0.034270799, 0.106020511, 0.143572175])
      assert_near(Quaternion.to_euler(other), [0.037879881, 0.220124031, 0.285771701])
      assert_near(Quaternion.to_euler(rotation, :zyx), [0.156419513, 0.160027220, 0.322609691])
      turned = Quaternion.rotate_vector(rotation, Vec3.new(1, 2, 3))
      assert_near(turned, [0.953042401, 1.908866613, 3.073749898])

      assert_near(Enum.concat(Quaternion.to_rotation_list(rotation)), [
        0.936293364,
        -0.289629478,
        0.198669331,
        0.312991826,
        0.944702486,
        -0.097843395,
        -0.159345079,
        0.153791998,
        0.975170327
      ])
    end

    test "at the pole has no roll" do
      rotation = Quaternion.from_euler(0.3, @half_pi, 0.4)
      assert_near(Quaternion.to_euler(rotation), [0.0, @half_pi, 0.7])
    end

    test "is the product of two, and the half of one" do
      about_x = Quaternion.from_axis_angle(Vec3.unit_x(), @half_pi)
      about_z = Quaternion.from_axis_angle(Vec3.unit_z(), @half_pi)
      assert_near(Quaternion.multiply(about_z, about_x), [0.5, 0.5, 0.5, 0.5])
      assert_near(Quaternion.rotate_vector(about_z, Vec3.unit_x()), [0, 1, 0])
      half = Quaternion.slerp(Quaternion.identity(), about_z, 0.5)
      assert_near(half, [0.923879533, 0, 0, 0.382683432])
      assert_raise FunctionClauseError, fn -> Quaternion.slerp(about_x, about_z, 1.1) end
    end

    test "turns one vector into another" do
      quarter = Quaternion.from_two_vectors(Vec3.unit_x(), Vec3.unit_y())
      assert_near(quarter, [0.707106781, 0, 0, 0.707106781])
      slanted = Quaternion.from_two_vectors(Vec3.new(1, 1, 0), Vec3.new(0, 1, 1))
      assert_near(slanted, [0.866025404, 0.288675135, -0.288675135, 0.288675135])

      for axis <- [Vec3.unit_x(), Vec3.unit_y(), Vec3.unit_z()] do
        back = Quaternion.from_two_vectors(axis, Vec3.negate(axis))
        turned = Quaternion.rotate_vector(back, axis)
        assert_near(turned, Vec3.to_list(Vec3.negate(axis)))
      end
    end
  end

  test "of two transforms, the second one acts first" do
    move = Transform.translation(Vec3.unit_x())
    turn = Transform.rotation_z(@half_pi)
    assert_near(apply_to_x(Transform.compose(move, turn)), [1, 1, 0])
    assert_near(apply_to_x(Transform.compose(turn, move)), [0, 2, 0])

    moves =
      for axis <- [Vec3.unit_x(), Vec3.unit_y(), Vec3.unit_z()], do: Transform.translation(axis)

    assert_near(Transform.get_translation(Transform.compose_all(moves)), [1, 1, 1])

    origin = Transform.from_origin(%{position: {1, 2, 3}, orientation: {0, 0, @half_pi}})
    assert_near(Transform.get_translation(origin), [-2, 1, 3])
  end

  test "vectors and rotations are shown as they are made, within the limit" do
    assert inspect(Vec3.new(1, 2, 3)) == "BB.Math.Vec3.new(1.0, 2.0, 3.0)"
    assert inspect(Vec3.new(1, 2, 3), limit: 2) == "BB.Math.Vec3.new(1.0, 2.0, ...)"
    assert inspect(Quaternion.identity()) == "BB.Math.Quaternion.new(1.0, 0.0, 0.0, 0.0)"
  end

  @texts [
    {%Invalid.CommandResult{value: :done}, ["result/1 returned :done"], []},
    {%Invalid.JointConfig{joint: :j, message: "no upper bound"}, ["no upper bound"], []},
    {%Invalid.Bridge.InvalidParamId{param_id: "a:b:c"}, [~s("a:b:c"), "servo_id:param_name"], []},
    {%Invalid.Bridge.ReadOnly{param_name: :firmware}, ["firmware"], []},
    {%Invalid.Bridge.TorqueMustBeDisabled{param_name: :id, servo_id: 3}, ["id", "servo 3"], []},
    {%Invalid.Bridge.TorqueMustBeDisabled{param_name: :id}, ["id"], ["servo"]},
    {%Invalid.Bridge.UnknownParam{param_name: :x, control_table: STS}, ["x", "STS"], []},
    {%Invalid.Bridge.UnknownParam{param_name: :x}, ["x"], ["not found"]},
    {%State.NotArmed{robot: R, actuator: :a}, ["robot is not armed", "refused"], []},
    {%State.UnsupportedCommand{robot: R, actuator: :a, supported: [Go, Halt]}, ["Go", "Halt"],
     []},
    {%BB.Error.Estimator.StaleInput{input_path: [:imu], age_ms: 120, budget_ms: 100},
     ["[:imu]", "120", "100"], []},
    {%Kinematics.UnknownLink{link: :gripper, robot: MyBot}, ["Unknown link: :gripper", "MyBot"],
     []},
    {%Kinematics.UnknownLink{link: :a, role: :source}, ["source link"], []},
    {%Kinematics.UnknownLink{link: :a, role: :target}, ["target link"], []},
    {%Kinematics.UnknownJoint{joint: :not_a_real_joint}, ["Unknown joint: :not_a_real_joint"],
     []},
    {%Kinematics.UnknownActuator{actuator: :pan_servo}, ["Unknown actuator: :pan_servo"], []},
    {%Kinematics.NoParentJoint{link: :torso}, [":torso", "root"], ["not found"]},
    {%Kinematics.NotAnAncestor{
       source_link: :left_gripper,
       target_link: :right_gripper,
       common_ancestor: :torso
     },
     [
       ":left_gripper is not an ancestor of :right_gripper",
       "nearest common ancestor is :torso"
     ], []},
    {%Kinematics.MultiFailed{
       failed_link: :b,
       error: :out_of_reach,
       partial_results: %{a: {:ok, %{}, %{}}, b: {:error, :out_of_reach}}
     }, ["1 target(s) solved before failure"], []}
  ]

  for {{error, words, others}, index} <- Enum.with_index(@texts) do
    @error error
    @words words
    @others others

    test "the text of #{inspect(error.__struct__)} has its words (#{index})" do
      text = Exception.message(@error)
      assert @error.__struct__.message(@error) == text
      for word <- @words, do: assert(text =~ word)
      for other <- @others, do: refute(text =~ other)
    end
  end

  @places [
    {BB.Sensor, "sensors do\n sensor :part, String\nend"},
    {BB.Controller, "controllers do\n controller :part, String\nend"},
    {BB.Bridge, "parameters do\n bridge :part, String\nend"},
    {BB.Actuator,
     "topology do\n link :base do\n joint :j, type: :fixed do\n link :tip\n " <>
       "actuator :part, String\n end\n end\nend"},
    {BB.Estimator,
     "topology do\n link :base do\n estimator :part, String do\n " <>
       "input :imu, [:imu]\n end\n end\nend"}
  ]

  for {behaviour, lines} <- @places do
    @behaviour_name inspect(behaviour)
    @lines lines

    test "a child that is no #{behaviour |> Module.split() |> List.last()} is refused" do
      error = mistake(@lines)
      assert error.message =~ "must implement the #{@behaviour_name} behaviour"
      assert List.last(error.path) == :part
    end
  end

  test "a mistake has the path of its place in its text" do
    error =
      mistake("""
      parameters do
        group :motion do
          param :mode, type: :float, default: -1.0, min: 0.0
        end
      end
      """)

    assert Exception.message(error) =~ "parameters -> motion -> mode"
    assert error.message =~ "invalid `default`: expected value to be at least 0.0"
  end

  # A driver's test may have a robot that it wrote out, without a declaration.
  defmodule Literal do
    @gears %{reduction: 2.0, offset: 0.5, reversed?: false}
    @limits %{lower: -1.0, upper: 1.0, velocity: 1.0, effort: 1.0, acceleration: nil}

    def robot do
      %BB.Robot{
        name: __MODULE__,
        root_link: :base,
        links: %{base: link(:base, nil, [:pan]), head: link(:head, :pan, [])},
        joints: %{
          pan: %BB.Robot.Joint{
            name: :pan,
            type: :revolute,
            parent_link: :base,
            child_link: :head,
            origin: nil,
            axis: nil,
            limits: @limits,
            dynamics: nil,
            sensors: [:encoder],
            actuators: [:servo]
          }
        },
        sensors: %{
          encoder: %{name: :encoder, attached_to: {:joint, :pan}, transmission: @gears}
        },
        actuators: %{servo: %{name: :servo, joint: :pan, transmission: @gears}},
        topology: %BB.Robot.Topology{
          link_order: [:base, :head],
          joint_order: [:pan],
          paths: %{base: [:base], pan: [:base, :pan], head: [:base, :pan, :head]},
          depth: %{base: 0, pan: 1, head: 2}
        },
        param_subscriptions: %{}
      }
    end

    defp link(name, parent, children) do
      %BB.Robot.Link{
        name: name,
        parent_joint: parent,
        child_joints: children,
        mass: nil,
        center_of_mass: nil,
        inertia: nil,
        visual: nil,
        collisions: [],
        sensors: []
      }
    end
  end

  test "a robot that is written out has transmissions and paths" do
    gears = %{reduction: 2.0, offset: 0.5, reversed?: false}
    assert Resolver.resolve(Literal, :actuator, :servo) == gears
    assert Resolver.resolve(Literal, :sensor, :encoder) == gears
    assert Resolver.resolve(Literal, :sensor, :unknown) == nil
    assert Resolver.resolve_and_subscribe(Literal, :actuator, :servo) == {gears, %{}}
    assert BB.Robot.actuator_path(Literal.robot(), :servo) == {:ok, [:base, :pan, :servo]}
    assert BB.Robot.path_between(Literal.robot(), :base, :head) == {:ok, [:base, :pan, :head]}

    motor = BB.Transmission.apply_position(0.25, gears)
    fields = [names: [:pan], positions: [motor]]
    message = BB.Message.new!(BB.Message.Sensor.JointState, :servo, fields)

    shaft = BB.Actuator.to_joint_space(Literal, [:base, :pan, :servo], message)
    assert shaft == BB.Sensor.to_joint_space(Literal, [:base, :pan, :encoder], message)
    assert [position] = shaft.payload.positions
    assert_in_delta position, 0.25, 1.0e-12
  end

  defp apply_to_x(transform), do: Transform.apply_to_point(transform, Vec3.unit_x())

  defp assert_near(%Vec3{} = vector, numbers), do: assert_near(Vec3.to_list(vector), numbers)

  defp assert_near(%Quaternion{} = rotation, numbers),
    do: assert_near(Quaternion.to_list(rotation), numbers)

  defp assert_near(tuple, numbers) when is_tuple(tuple),
    do: assert_near(Tuple.to_list(tuple), numbers)

  defp assert_near(list, numbers) do
    assert length(list) == length(numbers)
    for {a, b} <- Enum.zip(list, numbers), do: assert_in_delta(a, b, 1.0e-9)
  end
end

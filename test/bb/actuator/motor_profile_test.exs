defmodule BB.Actuator.MotorProfileTest do
  use ExUnit.Case, async: true

  use BB.Test.Prop

  import BB.Test.Robot

  alias BB.Actuator.MotorProfile
  alias BB.Test.Servo
  alias BB.Transmission

  doctest MotorProfile
  doctest BB.Robot.Limits

  test "of no joint or a joint without limits is empty" do
    assert MotorProfile.from_joint(nil, nil) == %MotorProfile{}
    assert MotorProfile.from_joint(%{limits: nil}, %{reduction: 2.0}) == %MotorProfile{}
    assert %MotorProfile{}.motor_initial_position == 0.0
  end

  test "without a transmission has the joint's limits" do
    limits = %{lower: -1.0, upper: 3.0, velocity: 2.0, acceleration: 4.0, effort: 8.0}

    assert MotorProfile.from_joint(%{limits: limits}, nil) == %MotorProfile{
             motor_lower: -1.0,
             motor_upper: 3.0,
             motor_velocity_limit: 2.0,
             motor_acceleration_limit: 4.0,
             motor_effort_limit: 8.0,
             motor_initial_position: 1.0
           }
  end

  test "leaves a missing bound out, and begins at 0.0 then" do
    for {limits, transmission, bounds} <- [
          {%{lower: -1.0, upper: nil}, nil, {-1.0, nil}},
          {%{lower: nil, upper: 2.0}, nil, {nil, 2.0}},
          # The lower bound of the joint is the upper one of a reversed motor.
          {%{lower: -1.0, upper: nil}, %{reduction: 2.0, offset: 0.0, reversed?: true},
           {nil, 2.0}}
        ] do
      profile = MotorProfile.from_joint(%{limits: limits}, transmission)
      assert {profile.motor_lower, profile.motor_upper} == bounds
      assert profile.motor_initial_position == 0.0
    end
  end

  property "holds exactly what the joint may do, whatever the transmission" do
    forall {sign, reduction, offset, reversed?, lower, range, rate} <-
             {oneof([-1.0, 1.0]), float(0.01, 100.0), float(-10.0, 10.0), boolean(),
              float(-10.0, 10.0), float(0.0, 10.0), float(0.0, 9.0)} do
      transmission = %{reduction: sign * reduction, offset: offset, reversed?: reversed?}
      assert_holds(transmission, lower, lower + range, rate)
      true
    end
  end

  defp assert_holds(transmission, lower, upper, rate) do
    limits = %{lower: lower, upper: upper, velocity: rate, effort: rate}
    profile = MotorProfile.from_joint(%{limits: limits}, transmission)

    assert profile.motor_lower <= profile.motor_upper
    assert profile.motor_velocity_limit >= 0.0
    assert profile.motor_effort_limit >= 0.0

    back = &Transmission.unapply_position(&1, transmission)
    [low, high] = Enum.sort([back.(profile.motor_lower), back.(profile.motor_upper)])
    assert_in_delta low, lower, 1.0e-6
    assert_in_delta high, upper, 1.0e-6
    assert_in_delta back.(profile.motor_initial_position), (lower + upper) / 2, 1.0e-6

    assert_in_delta abs(Transmission.unapply_rate(profile.motor_velocity_limit, transmission)),
                    limits.velocity,
                    1.0e-6

    assert_in_delta abs(Transmission.unapply_effort(profile.motor_effort_limit, transmission)),
                    limits.effort,
                    1.0e-6
  end

  test "follows the parameters of limits and transmission" do
    robot =
      robot do
        parameters do
          param :reach, type: {:unit, :degree}, default: ~u(90 degree)
          param :gear, type: :float, default: 2.0
        end

        topology do
          link :base do
            joint :elbow do
              type :revolute

              limit lower: ~u(0 degree),
                    upper: param([:reach]),
                    effort: ~u(1 newton_meter),
                    velocity: ~u(1 radian_per_second)

              actuator :servo, BB.Test.Servo do
                transmission reduction: param([:gear])
              end

              link :arm
            end
          end
        end
      end

    Servo.observe(robot)
    start_supervised!(robot)
    assert_receive {:servo, :servo, :init, opts}
    assert_in_delta opts[:motor_profile].motor_upper, :math.pi(), 1.0e-9
    assert BB.Test.Robot.await_all_up(robot)

    :ok = BB.Parameter.set(robot, [:reach], BB.Unit.new!(45, :degree))
    assert_receive {:servo, :servo, :handle_options, opts}
    assert_in_delta opts[:motor_profile].motor_upper, :math.pi() / 2, 1.0e-9

    :ok = BB.Parameter.set(robot, [:gear], 4.0)
    assert_receive {:servo, :servo, :handle_options, opts}
    assert_in_delta opts[:motor_profile].motor_upper, :math.pi(), 1.0e-9
    assert opts[:motor_profile].motor_velocity_limit == 4.0
  end
end

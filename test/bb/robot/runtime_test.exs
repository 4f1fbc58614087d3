defmodule BB.Robot.RuntimeTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Robot
  import BB.Unit, only: :sigils

  alias BB.Error.Invalid.JointConfig
  alias BB.Error.Kinematics.UnknownJoint
  alias BB.Math.{Transform, Transform2D}
  alias BB.Message.Sensor.JointState
  alias BB.Robot.{Runtime, State}

  doctest BB.Robot.State

  setup do
    robot =
      robot do
        parameters do
          param :top, type: {:unit, :degree}, default: ~u(90 degree)
          param :turn, type: {:unit, :degree}, default: ~u(90 degree)
          param :rate, type: :integer, default: 5
          param :mass, type: {:unit, :kilogram}, default: ~u(2 kilogram)
        end

        topology do
          link :base do
            inertial mass: param([:mass]) do
              origin x: ~u(1 meter)
            end

            sensor :probe, {BB.Test.Probe, rate: param([:rate])}

            joint :shoulder do
              type :revolute

              limit upper: param([:top]),
                    effort: ~u(1 newton_meter),
                    velocity: ~u(1 radian_per_second)

              axis pitch: param([:turn])
              actuator :motor, {BB.Test.Motor, rate: param([:rate])}
              sensor :encoder, BB.Test.Probe

              link :arm do
                joint :plane do
                  type :planar

                  axis do
                  end

                  link :cart
                end

                joint :weld do
                  type :fixed

                  link :tip do
                    joint :free do
                      type :floating
                      link :drone
                    end
                  end
                end
              end
            end
          end
        end
      end

    %{robot: robot}
  end

  test "a robot that is not started is an ArgumentError", %{robot: robot} do
    for call <- [:get_robot, :get_robot_state, :configurations, :velocities, :simulation_mode] do
      assert_raise ArgumentError, fn -> apply(Runtime, call, [robot]) end
    end
  end

  test "the description follows the parameters", %{robot: robot} do
    start_supervised!(robot)
    assert robot.robot().joints.shoulder.axis == nil
    assert robot.robot().links.base.mass == nil
    resolved = Runtime.get_robot(robot)
    assert_in_delta resolved.joints.shoulder.limits.upper, :math.pi() / 2, 1.0e-12
    assert_in_delta elem(resolved.joints.shoulder.axis, 0), 1.0, 1.0e-12
    assert resolved.links.base.mass == 2.0
    :ok = BB.Parameter.set(robot, [:mass], ~u(500 gram))
    assert Runtime.get_robot(robot).links.base.mass == 0.5
  end

  test "State.set_parameter reaches components and the description without a message", %{
    robot: robot
  } do
    start_supervised!(robot)
    {:ok, _} = BB.subscribe(robot, [:param])
    state = Runtime.get_robot_state(robot)
    assert State.get_parameter(state, [:rate]) == {:ok, 5}
    assert State.get_parameter(state, [:nothing]) == {:error, :not_found}
    :ok = State.set_parameter(state, [:rate], 7)
    :ok = State.set_parameter(state, [:top], ~u(45 degree))
    assert BB.call(robot, :motor, :options)[:rate] == 7
    assert_in_delta Runtime.get_robot(robot).joints.shoulder.limits.upper, 0.785398163, 1.0e-9
    refute_received {:bb, _, _}
  end

  test "the state is the safety state, or :idle while the robot is armed", %{robot: robot} do
    start_supervised!(robot)
    assert Runtime.state(robot) == :disarmed
    :ok = BB.Safety.arm(robot)
    assert Runtime.state(robot) == :idle
    assert Runtime.simulation_mode(robot) == nil
    assert GenServer.whereis(Runtime.via(robot)) |> is_pid()
  end

  test "the configurations are what sensors report", %{robot: robot} do
    start_supervised!(robot)

    assert Runtime.configurations(robot) == %{
             shoulder: 0.0,
             plane: Transform2D.identity(),
             weld: 0.0,
             free: Transform.identity()
           }

    plane = Transform2D.new(1, 2, 0.5)

    # The second entry is of no joint, the third of the wrong shape.
    publish(robot,
      names: [:shoulder, :nobody, :weld, :plane],
      positions: [0.5, 1.0, 2.0, plane],
      velocities: [0.25]
    )

    assert eventually(fn -> Runtime.configurations(robot).plane == plane end)
    assert %{shoulder: 0.5, weld: weld} = Runtime.configurations(robot)
    assert weld == 0.0
    assert eventually(fn -> Runtime.velocities(robot).shoulder == 0.25 end)
  end

  defp publish(robot, fields) do
    message = BB.Message.new!(JointState, :encoder, fields)
    BB.publish(robot, [:sensor, :base, :shoulder, :encoder], message)
  end

  describe "a state" do
    setup %{robot: robot} do
      {:ok, state} = State.new(robot.robot())
      %{state: state}
    end

    test "has the configurations along a chain", %{state: state} do
      :ok = State.set_configuration(state, :shoulder, 1)
      assert State.get_chain_configurations(state, :tip) == [shoulder: 1.0, weld: 0.0]
      assert State.get_chain_configurations(state, :base) == []
      assert State.get_chain_configurations(state, :nose) == []
    end

    test "takes all values or none", %{state: state} do
      assert {:error, %UnknownJoint{joint: :knee}} =
               State.set_configurations(state, shoulder: 1.0, knee: 1.0)

      assert {:error, %JointConfig{joint: :weld, field: :velocity, value: 1.0}} =
               State.set_velocities(state, %{shoulder: 1.0, weld: 1.0})

      assert State.get_configuration(state, :shoulder) == {:ok, 0.0}
      assert State.get_velocity(state, :shoulder) == {:ok, 0.0}
      :ok = State.set_configurations(state, %{shoulder: 1.0, weld: 0})
      assert State.get_all_configurations(state).shoulder == 1.0
      :ok = State.reset(state)
      assert State.get_all_configurations(state).shoulder == 0.0
    end

    test "refuses a value of the wrong shape", %{state: state} do
      for {joint, value} <- [shoulder: :up, plane: 1.0, free: Transform2D.identity(), weld: 1],
          do: assert({:error, %JointConfig{}} = State.set_configuration(state, joint, value))

      assert {:error, %UnknownJoint{}} = State.get_configuration(state, :nose)
      assert {:error, %UnknownJoint{}} = State.get_velocity(state, :nose)
    end

    test "has parameters of its own without a robot that runs", %{state: state} do
      assert State.get_parameter(state, [:rate]) == {:error, :not_found}
      :ok = State.set_parameter(state, [:rate], 3)
      assert State.get_parameter(state, [:rate]) == {:ok, 3}
    end
  end
end

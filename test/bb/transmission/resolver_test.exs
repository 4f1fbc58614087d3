defmodule BB.Transmission.ResolverTest do
  use ExUnit.Case, async: true

  import BB.Test.Robot

  alias BB.Transmission.Resolver

  setup do
    robot =
      robot do
        parameters do
          param :gear, type: :float, default: 2.0
          param :zero, type: {:unit, :degree}, default: ~u(180 degree)
        end

        topology do
          link :base do
            sensor :imu, BB.Test.Probe

            joint :elbow do
              type :continuous

              sensor :encoder, BB.Test.Probe do
                transmission reduction: param([:gear]), offset: param([:zero])
              end

              actuator :servo, BB.Test.Motor do
                transmission reduction: 5.0
              end

              link :arm
            end
          end
        end
      end

    %{robot: robot}
  end

  test "resolve/3 is the transmission with the values of its parameters, in SI", %{robot: robot} do
    start_supervised!(robot)

    assert Resolver.resolve(robot, :sensor, :encoder) ==
             %{reduction: 2.0, offset: :math.pi(), reversed?: false}

    assert Resolver.resolve(robot, :actuator, :servo) ==
             %{reduction: 5.0, offset: 0.0, reversed?: false}

    for {kind, name} <- [sensor: :imu, sensor: :nobody, actuator: :nobody],
        do: assert(Resolver.resolve(robot, kind, name) == nil)

    assert Resolver.resolve(NoRobot, :sensor, :encoder) == nil
  end

  test "a robot that was made by hand has the places of its sensors and actuators" do
    defmodule ByHand do
      def robot do
        gears = %{reduction: 3.0, offset: 0.0, reversed?: true}

        %BB.Robot{
          name: __MODULE__,
          sensors: %{encoder: %{name: :encoder, attached_to: {:joint, :elbow}, transmission: nil}},
          actuators: %{servo: %{name: :servo, joint: :elbow, transmission: gears}}
        }
      end
    end

    assert %{reduction: 3.0} = Resolver.resolve(ByHand, :actuator, :servo)
    assert Resolver.resolve(ByHand, :sensor, :encoder) == nil
    assert Resolver.joint(ByHand, :actuator, :servo) == :elbow
    assert Resolver.joint(ByHand, :sensor, :encoder) == :elbow
    assert Resolver.joint(ByHand, :sensor, :nobody) == nil
  end

  test "resolve_and_subscribe/3 follows the parameters, and handle_change/6 applies them", %{
    robot: robot
  } do
    start_supervised!(robot)
    {first, fields} = Resolver.resolve_and_subscribe(robot, :sensor, :encoder)
    assert fields == %{reduction: [:gear], offset: [:zero]}
    :ok = BB.Parameter.set(robot, [:gear], -4.0 * -1)
    assert_receive {:bb, [:param | path], _changed}
    changed = Resolver.handle_change(robot, :sensor, :encoder, first, fields, path)
    assert changed == %{first | reduction: 4.0}
    assert Resolver.handle_change(robot, :sensor, :encoder, first, fields, [:x]) == first
    assert {_, fields} = Resolver.resolve_and_subscribe(robot, :actuator, :servo)
    assert fields == %{}
  end
end

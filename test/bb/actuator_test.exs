defmodule BB.ActuatorTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Robot

  alias BB.Actuator.ActuatorProfile
  alias BB.Message.Sensor.Status

  doctest BB.Actuator

  setup do
    robot =
      robot do
        controllers do
          controller :balance, {BB.Test.Brain, rate: 3}, required: true
        end

        topology do
          link :base do
            joint :elbow do
              type :continuous
              sensor :encoder, BB.Test.Probe

              actuator :servo, {BB.Test.Motor, rate: 5} do
                required true
                transmission reduction: 3.0
              end

              actuator :brake, BB.Test.Motor
              link :arm
            end
          end
        end
      end

    %{robot: robot}
  end

  test "actuators and controllers are declared: by name, with place and transmission", %{
    robot: robot
  } do
    declared = robot.robot()
    transmission = %{reduction: 3.0, offset: 0.0, reversed?: false}
    place = {:joint, :elbow}

    assert declared.actuators == %{
             servo: %{name: :servo, joint: :elbow, attached_to: place, transmission: transmission},
             brake: %{name: :brake, joint: :elbow, attached_to: place, transmission: nil}
           }

    assert declared.controllers == %{
             balance: %{name: :balance, attached_to: :robot, transmission: nil}
           }

    assert declared.joints.elbow.actuators == [:servo, :brake]
    assert {:ok, servo} = BB.Robot.fetch_component(declared, :servo)
    assert %{path: [:base, :elbow, :servo], kind: BB.Actuator, required: true} = servo
    assert {:ok, balance} = BB.Robot.fetch_component(declared, :balance)
    assert %{path: [:balance], kind: BB.Controller, required: true} = balance
    assert BB.Component.data_path(balance) == [:controller, :balance]
  end

  test "they are addressed by name", %{robot: robot} do
    start_supervised!(robot)
    opts = BB.call(robot, :servo, :options)
    assert opts[:bb] == %{robot: robot, path: [:base, :elbow, :servo]}
    assert opts[:rate] == 5

    assert opts[:actuator_profile] == %ActuatorProfile{
             joint_name: :elbow,
             transmission: %{reduction: 3.0, offset: 0.0, reversed?: false}
           }

    assert BB.call(robot, :brake, :options)[:actuator_profile].transmission == nil
    opts = BB.call(robot, :balance, :options)
    assert Enum.sort(opts) == [bb: %{robot: robot, path: [:balance]}, rate: 3]
  end

  test "they are siblings of sensors in the tree, each under its keeper", %{robot: robot} do
    start_supervised!(robot)
    ids = for {id, _pid} <- supervisors(robot), do: id
    topology = [robot, BB.TopologySupervisor]
    joint = topology ++ [{:link, :base}, {:joint, :elbow}]

    for id <-
          [topology ++ [BB.ControllerSupervisor, {:controller, :balance}]] ++
            for(child <- [sensor: :encoder, actuator: :servo], do: joint ++ [child]),
        do: assert(id in ids)
  end

  test "they restart alone, and their statuses have paths of their kind", %{robot: robot} do
    start_supervised!(robot)
    assert eventually(fn -> Enum.all?(all(robot), &(&1.state == :up)) end)
    {:ok, _} = BB.subscribe(robot, [:actuator_status])
    {:ok, _} = BB.subscribe(robot, [:controller_status])
    encoder = BB.Process.whereis(robot, :encoder)
    supervisors = supervisors(robot)

    for {name, kind, path, reason} <- [
          {:servo, :actuator, [:base, :elbow, :servo], :stalled},
          {:balance, :controller, [:balance], :confused}
        ] do
      BB.cast(robot, name, :stop)
      status = [:"#{kind}_status" | path]

      assert_receive {:bb, ^status,
                      %{frame_id: ^name, payload: %Status{state: :backoff, reason: ^reason}}}

      assert_receive {:bb, ^status, %{payload: %Status{state: :up, restarts: 1}}}
    end

    assert BB.Process.whereis(robot, :encoder) == encoder
    assert supervisors(robot) == supervisors

    assert [%{name: :servo, restarts: 1}, %{name: :brake, restarts: 0}] =
             BB.Actuator.health(robot)

    assert [%{name: :balance, restarts: 1}] = BB.Controller.health(robot)
    assert [%{name: :encoder}] = BB.Sensor.health(robot)
  end

  test "their wrong options fail the start of the robot" do
    robot =
      robot do
        controllers do
          controller :balance, {BB.Test.Brain, rate: 1.0}
        end
      end

    assert {:error, %BB.Options.ValidationError{} = error} = robot.start_link()

    assert Exception.message(error) ==
             "invalid value for :rate option: expected integer, got: 1.0 (in options [:balance])"
  end

  test "their names are unique among all components, and each module is of its kind" do
    import BB.Test.Mistake, only: [mistake: 1]

    assert mistake(
             "sensors do\n sensor :x, BB.Test.Probe\n end\n controllers do\n controller :x, BB.Test.Brain\n end"
           ).reason =~ "duplicate name :x: controller :x has the name of a sensor"

    assert mistake("controllers do\n controller :x, BB.Test.Probe\n end").reason ==
             "controller :x: BB.Test.Probe must implement the BB.Controller behaviour; add `use BB.Controller` to it"

    error = mistake("topology do\n link :b do\n actuator :x, BB.Test.Motor\n link :c\n end\n end")

    assert error.reason =~ "actuator cannot stand in a link; it belongs in a joint"
  end

  test "a reason is formatted" do
    assert BB.Actuator.explain(BB.Test.Motor, {:init_timeout, 5_000}) =~
             "init/1 has not returned"

    assert BB.Controller.explain(BB.Test.Brain, "tired") == "tired"
  end

  defp all(robot),
    do: Enum.flat_map([BB.Sensor, BB.Actuator, BB.Controller], & &1.health(robot))
end

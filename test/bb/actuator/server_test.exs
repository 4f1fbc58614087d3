defmodule BB.Actuator.ServerTest do
  use ExUnit.Case, async: true

  alias BB.Test.Servo

  setup do
    robot = Module.concat(__MODULE__, "R#{System.unique_integer([:positive])}")
    start_supervised!({BB.PubSub, robot})
    Servo.observe(robot)
    %{robot: robot, bb: %{robot: robot, path: [:base, :elbow, :servo]}}
  end

  test "each kind has a server for tests of drivers, with a name of the caller's", %{bb: bb} do
    for {server, module} <- [
          {BB.Sensor.Server, BB.Test.Probe},
          {BB.Actuator.Server, Servo},
          {BB.Controller.Server, BB.Test.Brain}
        ] do
      options = if module == BB.Test.Brain, do: [rate: 1], else: []
      arguments = [__callback_module__: module, bb: bb] ++ options
      name = Module.concat(bb.robot, server)
      assert {:ok, pid} = server.start_link(arguments, name: name)
      assert Process.whereis(name) == pid
      assert {:ok, unnamed} = server.start_link(arguments)
      assert Process.info(unnamed, :registered_name) == {:registered_name, []}
      assert %{start: {^server, :start_link, [^arguments]}} = server.child_spec(arguments)
    end
  end

  test "has the driver's state in `user_state`, and an empty profile without a joint", %{bb: bb} do
    pid = start_supervised!({BB.Actuator.Server, __callback_module__: Servo, bb: bb})
    assert :sys.get_state(pid).user_state.profile == %BB.Actuator.MotorProfile{}
    assert_receive {:servo, :servo, :init, options}
    assert Keyword.keys(options) -- [:gain, :payloads] == [:bb, :motor_profile, :actuator_profile]
  end

  test "reports a wrong option", %{bb: bb} do
    arguments = [__callback_module__: Servo, bb: bb, gain: 1]
    Process.flag(:trap_exit, true)

    assert {:error, %BB.Options.ValidationError{key: :gain}} =
             BB.Actuator.Server.start_link(arguments)
  end
end

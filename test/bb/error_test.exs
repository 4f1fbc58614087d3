defmodule BB.ErrorTest do
  use ExUnit.Case, async: true

  doctest BB.Error
  doctest BB.Error.Text

  doctest BB.Error.Hardware.BusError
  doctest BB.Error.Hardware.DeviceError
  doctest BB.Error.Hardware.Disconnected
  doctest BB.Error.Hardware.Timeout
  doctest BB.Error.Invalid.Command
  doctest BB.Error.Invalid.CommandResult
  doctest BB.Error.Invalid.JointConfig
  doctest BB.Error.Invalid.Parameter
  doctest BB.Error.Invalid.Topology
  doctest BB.Error.Invalid.Bridge.InvalidParamId
  doctest BB.Error.Invalid.Bridge.ReadOnly
  doctest BB.Error.Invalid.Bridge.TorqueMustBeDisabled
  doctest BB.Error.Invalid.Bridge.UnknownParam
  doctest BB.Error.State.NotArmed
  doctest BB.Error.State.UnsupportedCommand
  doctest BB.Error.State.StaleEpoch
  doctest BB.Error.State.NotAllowed
  doctest BB.Error.State.Invalid
  doctest BB.Error.State.Preempted
  doctest BB.Error.State.Timeout
  doctest BB.Error.State.CommandCrashed
  doctest BB.Error.Category.Full
  doctest BB.Error.Estimator.MissingCovariance
  doctest BB.Error.Estimator.StaleInput
  doctest BB.Error.Estimator.SyncMiss
  doctest BB.Error.Kinematics.UnknownLink
  doctest BB.Error.Kinematics.UnknownJoint
  doctest BB.Error.Kinematics.UnknownActuator
  doctest BB.Error.Kinematics.NoParentJoint
  doctest BB.Error.Kinematics.NotAnAncestor
  doctest BB.Error.Kinematics.NoDofs
  doctest BB.Error.Kinematics.NoSolution
  doctest BB.Error.Kinematics.Unreachable
  doctest BB.Error.Kinematics.Singularity
  doctest BB.Error.Kinematics.SelfCollision
  doctest BB.Error.Kinematics.MultiFailed
  doctest BB.Error.Safety.CollisionRisk
  doctest BB.Error.Safety.DisarmFailed
  doctest BB.Error.Safety.EmergencyStop
  doctest BB.Error.Safety.LimitExceeded
  import ExUnit.CaptureIO, only: [with_io: 2]

  alias BB.Error.{Hardware, Invalid, Kinematics, Safety, State}
  alias BB.Test.Overheated

  @errors [
    BB.Error.Hardware.BusError,
    BB.Error.Hardware.DeviceError,
    BB.Error.Hardware.Disconnected,
    BB.Error.Hardware.Timeout,
    BB.Error.Invalid.Command,
    BB.Error.Invalid.CommandResult,
    BB.Error.Invalid.JointConfig,
    BB.Error.Invalid.Parameter,
    BB.Error.Invalid.Topology,
    BB.Error.Invalid.Bridge.InvalidParamId,
    BB.Error.Invalid.Bridge.ReadOnly,
    BB.Error.Invalid.Bridge.TorqueMustBeDisabled,
    BB.Error.Invalid.Bridge.UnknownParam,
    BB.Error.State.NotArmed,
    BB.Error.State.UnsupportedCommand,
    BB.Error.State.StaleEpoch,
    BB.Error.State.NotAllowed,
    BB.Error.State.Invalid,
    BB.Error.State.Preempted,
    BB.Error.State.Timeout,
    BB.Error.State.CommandCrashed,
    BB.Error.Category.Full,
    BB.Error.Estimator.MissingCovariance,
    BB.Error.Estimator.StaleInput,
    BB.Error.Estimator.SyncMiss,
    BB.Error.Kinematics.UnknownLink,
    BB.Error.Kinematics.UnknownJoint,
    BB.Error.Kinematics.UnknownActuator,
    BB.Error.Kinematics.NoParentJoint,
    BB.Error.Kinematics.NotAnAncestor,
    BB.Error.Kinematics.NoDofs,
    BB.Error.Kinematics.NoSolution,
    BB.Error.Kinematics.Unreachable,
    BB.Error.Kinematics.Singularity,
    BB.Error.Kinematics.SelfCollision,
    BB.Error.Kinematics.MultiFailed,
    BB.Error.Safety.CollisionRisk,
    BB.Error.Safety.DisarmFailed,
    BB.Error.Safety.EmergencyStop,
    BB.Error.Safety.LimitExceeded
  ]

  @namespaces [
    BB.Error.Hardware,
    BB.Error.Invalid,
    BB.Error.Invalid.Bridge,
    BB.Error.Kinematics,
    BB.Error.Protocol,
    BB.Error.Safety,
    BB.Error.State,
    BB.Error.Estimator,
    BB.Error.Category
  ]

  test "each error has a text without any field, a class and a severity" do
    for module <- @errors do
      error = module.exception([])
      assert error == struct(module)
      assert is_exception(error)

      assert is_binary(module.message(error)) and
               module.message(error) == Exception.message(error)

      assert is_atom(error.class) and error.class != nil
      assert BB.Error.severity(error) in [:critical, :error, :warning]
      assert BB.Error.Severity.severity(error) == BB.Error.severity(error)
    end
  end

  test "the errors of safety are critical, and those of late inputs are warnings" do
    for module <- @errors do
      expected =
        case Module.split(module) do
          ["BB", "Error", "Safety", _name] -> :critical
          ["BB", "Error", "Estimator", late] when late in ~w(StaleInput SyncMiss) -> :warning
          _other -> :error
        end

      error = struct(module)
      assert {module, BB.Error.severity(error)} == {module, expected}
      assert BB.Error.critical?(error) == (expected == :critical)
    end
  end

  test "the namespaces exist" do
    for module <- @namespaces, do: assert(Code.ensure_loaded?(module))
  end

  describe "an error of a driver" do
    test "has its fields, its defaults and its class" do
      assert %Overheated{device: nil, celsius: 90, class: :hardware} = Overheated.exception([])
      error = Overheated.exception(device: "esc", celsius: 101)
      assert Exception.message(error) == "device esc is at 101 °C"
      assert BB.Error.critical?(error)
      refute BB.Error.critical?(%{error | celsius: 99})
      assert_raise Overheated, "device esc is at 90 °C", fn -> raise Overheated, device: "esc" end
    end

    test "without a severity does not compile" do
      source = """
      defmodule BB.ErrorTest.WithoutSeverity do
        use BB.Error, class: :hardware, fields: [:device]
        def message(_error), do: "text"
      end
      """

      error = assert_raise CompileError, fn -> Code.compile_string(source, "lib/error.ex") end
      assert error.description =~ "BB.ErrorTest.WithoutSeverity does not implement"
      assert error.description =~ "defimpl BB.Error.Severity do"

      assert_raise CompileError, ~r/BB.Error.Severity/, fn ->
        defmodule Inline do
          use BB.Error, class: :hardware, fields: []
          def message(_error), do: "text"
        end
      end
    end

    test "with other options does not compile" do
      wrong = ["fields: [:a]", "class: 1", "class: :a, fields: [1]", "class: :a, text: 1"]

      for options <- wrong do
        source = "defmodule BB.ErrorTest.Wrong do\n  use BB.Error, #{options}\nend"

        assert_raise ArgumentError, ~r/^expected `use BB.Error, class: atom.* got: /, fn ->
          Code.compile_string(source, "lib/error.ex")
        end
      end
    end

    test "may have a type of its own, and be compiled after the protocol is consolidated" do
      source = """
      defmodule BB.ErrorTest.Typed do
        use BB.Error, class: :protocol, fields: [:message]
        @type t :: %__MODULE__{message: String.t()}
        defimpl BB.Error.Severity, do: def(severity(_error), do: :warning)
        def message(error), do: "alert: \#{error.message}"
      end
      """

      {compiled, _warning} =
        with_io(:stderr, fn -> Code.compile_string(source, "lib/error.ex") end)

      modules = for {module, _code} <- compiled, do: module
      assert [module] = modules -- [BB.Error.Severity.BB.ErrorTest.Typed]
      assert Exception.message(module.exception(message: "hot")) == "alert: hot"
      assert BB.Error.severity(module.exception([])) == :warning
    end
  end

  test "a value that is no error has no severity" do
    assert_raise Protocol.UndefinedError, fn -> BB.Error.severity(:timeout) end
    assert_raise Protocol.UndefinedError, fn -> BB.Error.severity(%RuntimeError{}) end
  end

  describe "the text of" do
    test "a joint's configuration is the message if there is one" do
      assert text(%Invalid.JointConfig{joint: :pan, message: "no limits"}) ==
               "joint :pan: no limits"
    end

    test "a torque that must be off names the servo, if known" do
      error = %Invalid.Bridge.TorqueMustBeDisabled{param_name: :id}
      refute text(error) =~ "servo"
      assert text(%{error | servo_id: 3}) =~ "servo 3"
    end

    test "an unknown remote parameter names the table, if known" do
      error = %Invalid.Bridge.UnknownParam{param_name: :speed}
      refute text(error) =~ "not found"
      assert text(%{error | control_table: STS3215}) =~ "STS3215"
    end

    test "an unknown link names its role and the robot, if known" do
      error = %Kinematics.UnknownLink{link: :gripper}
      assert text(error) == "Unknown link: :gripper"
      assert text(%{error | role: :source}) =~ "source link"
      assert text(%{error | role: :target}) =~ "target link"
      assert text(%{error | robot: MyRobot}) =~ "MyRobot"
      assert text(%{error | robot: %{name: :arm}}) =~ ":arm"
    end

    test "links without a common ancestor" do
      error = %Kinematics.NotAnAncestor{source_link: :a, target_link: :b}
      assert text(error) == ":a is not an ancestor of :b"
      assert text(%{error | common_ancestor: :c}) =~ "nearest common ancestor is :c"
    end

    test "several targets counts those that were solved" do
      results = %{a: {:ok, %{}, %{}}, b: {:error, :no}, c: {:ok, %{}, %{}}}
      error = %Kinematics.MultiFailed{failed_link: :b, error: :no, partial_results: results}
      assert text(error) =~ "2 target(s) solved before failure"
      assert text(%{error | partial_results: Map.to_list(results)}) =~ "2 target(s)"
      assert text(%{error | partial_results: Map.values(results)}) =~ "2 target(s)"
    end

    test "a refused command says what is allowed" do
      command = BB.Message.Actuator.Command.Position
      error = %State.UnsupportedCommand{actuator: :servo, command: command, supported: [command]}
      assert text(error) =~ "supports [BB.Message.Actuator.Command.Position]"
      assert text(%State.NotArmed{robot: MyRobot}) =~ "robot is not armed"
      assert text(%State.NotArmed{robot: MyRobot}) =~ "refused"
    end

    test "a failed disarm shows its failures if there is no reason" do
      assert text(%Safety.DisarmFailed{failures: [{[:a], :timeout}]}) =~ "{[:a], :timeout}"
    end

    test "an error with a text that is no UTF-8" do
      assert text(%Hardware.BusError{reason: <<255>>}) =~ "<<255>>"
    end
  end

  defp text(error), do: Exception.message(error)
end

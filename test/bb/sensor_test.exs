defmodule BB.SensorTest do
  use ExUnit.Case, async: true

  import BB.Test.Robot

  alias BB.Message.Sensor.JointState

  doctest BB.Sensor

  defmodule ByUse do
    use BB.Sensor, options_schema: [rate: [type: :float, required: true]]

    @impl BB.Sensor
    def init(_opts), do: {:ok, nil}
  end

  defmodule ByFunction do
    use BB.Sensor

    @impl BB.Sensor
    def options_schema, do: [rate: [type: :integer, default: 1]]

    @impl BB.Sensor
    def init(_opts), do: {:ok, nil}
  end

  defmodule WithoutSchema do
    use BB.Sensor

    @impl BB.Sensor
    def init(_opts), do: {:ok, nil}
  end

  defp start(module, options) do
    robot =
      create(
        quote do
          sensors do
            sensor(:s, {unquote(module), unquote(options)})
          end
        end
      )

    case robot.start_link() do
      {:ok, pid} -> Supervisor.stop(pid)
      {:error, error} -> Exception.message(error)
    end
  end

  describe "the schema of options" do
    test "is declared by `use`" do
      assert start(ByUse, rate: 1.0) == :ok

      assert start(ByUse, []) ==
               "required :rate option not found, received options: [] (in options [:s])"
    end

    test "or by options_schema/0" do
      assert start(ByFunction, []) == :ok

      assert start(ByFunction, rate: 1.0) ==
               "invalid value for :rate option: expected integer, got: 1.0 (in options [:s])"
    end

    test "is empty when there is none" do
      assert start(WithoutSchema, []) == :ok

      assert start(WithoutSchema, rate: 1) ==
               "unknown options [:rate], valid options are: [] (in options [:s])"
    end

    test "declared both ways is a CompileError" do
      source = """
      defmodule BB.SensorTest.Both do
        use BB.Sensor, options_schema: []
        def options_schema, do: []
        def init(_), do: {:ok, nil}
      end
      """

      assert_raise CompileError,
                   ~r/BB.SensorTest.Both.*Declare the schema one way, not both/,
                   fn ->
                     Code.compile_string(source)
                   end
    end

    test "that is invalid fails to compile" do
      source =
        "defmodule BB.SensorTest.Bad do use BB.Sensor, options_schema: [a: [type: :flaot]] end"

      assert_raise ArgumentError, ~r/invalid BB.Options schema/, fn ->
        Code.compile_string(source)
      end
    end

    test "an unknown option of `use` fails to compile" do
      source = "defmodule BB.SensorTest.Bad do use BB.Sensor, schema: [] end"

      assert_raise ArgumentError, ~r/unknown keys \[:schema\]/, fn ->
        Code.compile_string(source)
      end
    end
  end

  test "the defaults of the optional callbacks" do
    assert WithoutSchema.handle_options([], :s) == {:ok, :s}

    assert WithoutSchema.handle_call(:x, {self(), make_ref()}, :s) ==
             {:reply, {:error, :not_implemented}, :s}

    assert WithoutSchema.handle_cast(:x, :s) == {:noreply, :s}
    assert WithoutSchema.handle_info(:x, :s) == {:noreply, :s}
    assert WithoutSchema.handle_continue(:x, :s) == {:noreply, :s}
    assert WithoutSchema.terminate(:x, :s) == :ok
    refute function_exported?(WithoutSchema, :disarm, 1)
  end

  describe "publish_joint_state" do
    setup do
      robot =
        robot do
          topology do
            link :base do
              sensor :pots, BB.Test.Probe

              joint :elbow do
                type :continuous
                sensor :encoder, BB.Test.Probe
                link :arm
              end
            end
          end
        end

      start_supervised!(robot)
      {:ok, _} = BB.subscribe(robot, [:sensor])
      %{robot: robot}
    end

    test "uses the joint to which the sensor is attached", %{robot: robot} do
      path = [:base, :elbow, :encoder]
      assert BB.Sensor.publish_joint_state(robot, path, positions: [0.5]) == :ok

      assert_receive {:bb, [:sensor | ^path], %{frame_id: :elbow, payload: %JointState{} = state}}
      assert %{names: [:elbow], positions: [0.5], velocities: [], efforts: []} = state
    end

    test "uses the sensor itself elsewhere, with the given names", %{robot: robot} do
      path = [:base, :pots]
      BB.Sensor.publish_joint_state(robot, path, names: [:a, :b], positions: [0.5, 1.0])
      assert_receive {:bb, [:sensor | ^path], %{frame_id: :pots, payload: %JointState{} = state}}
      assert state.names == [:a, :b]
      BB.Sensor.publish_joint_state(robot, path, velocities: [1.0])
      assert_receive {:bb, [:sensor | ^path], %{payload: %JointState{names: [:pots]}}}
    end

    test "raises for wrong fields", %{robot: robot} do
      assert_raise BB.Options.ValidationError, fn ->
        BB.Sensor.publish_joint_state(robot, [:base, :pots], positions: ["far"])
      end
    end
  end
end

defmodule BB.Dsl.WarningsTest do
  # Captures the output of all processes on stderr.
  use ExUnit.Case, async: false

  import BB.Test.Mistake
  import ExUnit.CaptureIO

  # What the compiler prints about a robot that it compiles.
  defp warnings(lines) do
    name = "Warned#{System.unique_integer([:positive])}"
    source = "defmodule #{name} do\n  use BB\n#{lines}\nend"
    compile = fn -> assert [{_robot, _}] = Code.compile_string(source, "robot.ex") end

    # Other tests may print at the same time.
    :stderr
    |> capture_io(compile)
    |> String.split("warning: ")
    |> Enum.filter(&(&1 =~ name))
    |> Enum.join()
  end

  defmodule Knowing do
    use BB.Actuator

    @impl BB.Actuator
    def capabilities(opts), do: if(opts[:encoder], do: [:position_feedback], else: [])

    @impl BB.Actuator
    def init(opts), do: {:ok, opts}

    @impl BB.Actuator
    def disarm(_opts), do: :ok

    @impl BB.Actuator
    def handle_command(_message, state), do: {:noreply, state}
  end

  describe "a joint whose position nobody reports" do
    defp driven(type, inside) do
      limit =
        if type == :prismatic,
          do: "limit effort: ~u(1 newton), velocity: ~u(1 meter_per_second)",
          else: "limit effort: ~u(1 newton_meter), velocity: ~u(1 radian_per_second)"

      warnings("""
      topology do
        link :base do
          joint :shoulder, type: #{inspect(type)} do
            #{if type == :continuous, do: "", else: limit}
            #{inside}
            link :arm
          end
        end
      end
      """)
    end

    test "is named with its actuators, and with what to do" do
      text = driven(:revolute, "actuator :motor, BB.Test.Nowhere.Motor")
      refute text =~ "nothing reports"

      text = driven(:revolute, "actuator :motor, {BB.Dsl.WarningsTest.Knowing, []}")
      assert text =~ "joint :shoulder is driven by :motor but nothing reports where it is"
      assert text =~ "OpenLoopPositionEstimator"
      assert text =~ "def capabilities(_opts), do: [:position_feedback]"
      assert text =~ "robot.ex:5"

      two =
        "actuator :right, BB.Dsl.WarningsTest.Knowing\nactuator :left, BB.Dsl.WarningsTest.Knowing"

      assert driven(:prismatic, two) =~ "is driven by :left, :right but nothing reports"
    end

    test "is none with a sensor, with feedback, or where the joint has no end" do
      motor = "actuator :motor, BB.Dsl.WarningsTest.Knowing"
      refute driven(:revolute, motor <> "\nsensor :s, BB.Test.Probe") =~ "nothing reports"
      refute driven(:continuous, motor) =~ "nothing reports"

      feedback = "actuator :motor, {BB.Dsl.WarningsTest.Knowing, encoder: true}"
      refute driven(:revolute, feedback) =~ "nothing reports"
    end
  end

  test "a module that cannot be loaded, and options that it refuses, are named" do
    assert warnings("sensors do\n sensor :s, BB.Test.Nowhere\n end") =~
             "sensor :s: module BB.Test.Nowhere cannot be loaded"

    text = warnings("sensors do\n sensor :s, {BB.Test.Probe, rate: :fast}\n end")
    assert text =~ "sensor :s: wrong options for BB.Test.Probe: invalid value for :rate"
  end

  test "an option that follows a parameter is right" do
    text =
      warnings("""
      parameters do
        param :rate, type: :integer
      end

      sensors do
        sensor :s, {BB.Test.Probe, rate: param([:rate])}
      end
      """)

    assert text == ""
  end

  describe "commands and states" do
    test "that do not exist are warnings" do
      text =
        warnings("""
        commands do
          command :home, handler: BB.Test.Nowhere, allowed_states: [:idle, :flying]
          command :go, handler: {BB.Command.SetState, to: :gone}
          command :push, handler: BB.Test.Nowhere, category: :motion, cancel: [:force]
        end

        states do
          initial_state :asleep
        end
        """)

      assert text =~ "command :home references undefined states [:flying]"
      assert text =~ "command :go targets undefined state :gone"
      assert text =~ "Invalid initial_state :asleep"
      assert text =~ "command :push references undefined category :motion"
      assert text =~ "command :push references undefined category :force"
    end

    test "that cannot arm or disarm are mistakes" do
      commands = fn lines -> mistake("commands do\n#{lines}\nend").reason end
      flagged = "handler: BB.Test.Nowhere, allowed_states: :*"

      assert commands.("command :a, #{flagged}, arm: true\ncommand :b, #{flagged}, arm: true") =~
               "Multiple commands have `arm true`"

      assert commands.(
               "command :a, #{flagged}, disarm: true\ncommand :b, #{flagged}, disarm: true"
             ) =~ "Multiple commands have `disarm true`"

      assert commands.("command :a, #{flagged}, arm: true, disarm: true") =~
               "both `arm true` and `disarm true`"

      assert commands.("command :a, handler: BB.Test.Nowhere, arm: true") =~
               ~r/must include.*:disarmed/

      assert commands.(
               "command :a, handler: BB.Test.Nowhere, disarm: true, allowed_states: :disarmed"
             ) =~ ~r/must be.*runnable from an armed state/

      assert commands.("command :a") =~ "command :a has no handler"

      error = mistake("states do\n state :error\n end").reason
      assert error =~ "Cannot define a state named :error"
      assert error =~ "belongs to the safety system"
      assert warnings("states do\n state :disarmed\n end") == ""
    end
  end

  describe "an estimator" do
    defp estimators(lines) do
      capture_io(:stderr, fn ->
        source = "topology do\n link :base do\n sensor :imu, BB.Test.Probe\n#{lines}\nend\nend"
        send(self(), mistake(source).reason)
      end)

      receive do: (reason -> reason)
    end

    test "has inputs that exist, one of which drives" do
      e = "estimator :e, BB.Test.Nowhere do\n"
      imu = "[:sensor, :base, :imu]"
      assert estimators(e <> "end") =~ "must declare at least one `input`"
      assert estimators(e <> "input :a, [:sensor, :nose]\nend") =~ "unknown path"

      assert estimators(e <> "input :a, #{imu}\ninput :b, #{imu}\nend") =~ "no driver"

      assert estimators(
               e <> "input :a, #{imu}, driver?: true\ninput :b, #{imu}, driver?: true\nend"
             ) =~ "multiple driver inputs"

      assert estimators(e <> "input :a, #{imu}\nsync_tolerance ~u(1 second)\nend") =~
               "single input but declares `sync_tolerance`"

      assert estimators(e <> "input :a, [:estimator, :base, :e]\nend") =~ "self-cycle"

      cycle = """
      estimator :a, BB.Test.Nowhere do
        input :x, [:estimator, :base, :b]
      end
      estimator :b, BB.Test.Nowhere do
        input :x, [:estimator, :base, :a]
      end
      """

      assert estimators(cycle) =~ "cycle: :a reads :b reads :a"

      assert estimators(e <> "input :a, #{imu}\non_degraded :no_such_command\nend") =~
               "on_degraded references unknown command :no_such_command"
    end
  end
end

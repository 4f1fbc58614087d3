defmodule Ganglion.ConsoleTest do
  # The simulated buses, the configuration and the names of the guard are those of the VM.
  use ExUnit.Case, async: false

  import BB.Test.Eventually
  import BB.Test.Robot
  import ExUnit.CaptureIO

  alias BB.Message.Sensor.Range
  alias BB.Test.Probe
  alias Ganglion.Console

  setup do
    robot =
      robot do
        parameters do
          param :debug, type: :boolean, default: false
        end

        sensors do
          sensor :quiet, BB.Test.Probe
        end

        topology do
          link :base_link do
            sensor :range, BB.Test.Probe, required: true
          end
        end
      end

    Probe.script(robot, :quiet,
      init: fn _ -> {:stop, {:a_very_long_reason, String.duplicate("x", 200)}} end
    )

    start_supervised!(robot)

    eventually(fn ->
      health(robot, :range).state == :up and health(robot, :quiet).state == :backoff
    end)

    %{robot: robot}
  end

  defp range do
    fields = [
      radiation_type: :infrared,
      field_of_view: 0.1,
      min_range: 0.02,
      max_range: 1.5,
      range: 0.4
    ]

    BB.Message.new!(Range, :range, fields)
  end

  # What a function prints; every line of it fits a terminal.
  defp shown(fun) do
    text = capture_io(fn -> assert fun.() == :"do not show this result in output" end)
    for line <- String.split(text, "\n"), do: assert(String.length(line) <= 80, line)
    refute text =~ "that did not work"
    text
  end

  test "sensors and health show each sensor and why it is down", %{robot: robot} do
    BB.publish(robot, [:sensor, :base_link, :range], range())
    assert shown(fn -> Console.sensors(robot) end) =~ ~r/range +up +\d+\.\d +- +\d+ ms +0/
    assert shown(fn -> Console.sensors(robot) end) =~ ~r/\nquiet: {:a_very_long_reason,\n/
    health = shown(fn -> Console.health(robot) end)
    assert health =~ ~r/quiet +no +backoff +\d+ +{:a_very_long/
    assert health =~ ~r/range +yes +up/
  end

  test "topics shows what was published", %{robot: robot} do
    BB.publish(robot, [:sensor, :base_link, :range], range())
    assert shown(fn -> Console.topics(robot) end) =~ ~r"sensor/base_link/range +Sensor.Range"
  end

  test "watch shows what is published meanwhile, and leaves nothing in the mailbox", %{
    robot: robot
  } do
    {:ok, publisher} = Task.start_link(fn -> publish_for_ever(robot) end)
    text = shown(fn -> Console.watch([:sensor], seconds: 0.2, robot: robot) end)
    Process.unlink(publisher)
    Process.exit(publisher, :kill)
    assert text =~ "sensor/base_link/range %BB.Message.Sensor.Range{"
    assert text =~ "watched for 0.2 s"
    assert BB.PubSub.subscribers(robot, [:sensor]) == []
  end

  test "ring shows the topics in shared memory" do
    topic = BB.Test.Native.topic("console")
    {:ok, publisher} = BB.Ring.Publisher.open(topic)
    # A name as long as that of a test's topic is cut off.
    shown_name = topic |> String.slice(0, 20) |> Regex.escape()
    assert shown(fn -> Console.ring() end) =~ ~r/^#{shown_name}\S* +live +0 +16/m
    BB.Ring.Publisher.close(publisher)
  end

  test "params shows values and defaults", %{robot: robot} do
    :ok = BB.Parameter.set(robot, [:debug], true)
    assert shown(fn -> Console.params([], robot) end) =~ ~r/debug +true +false +:boolean/
  end

  test "arm, disarm, estop and release say how the robot is then", %{robot: robot} do
    name = inspect(robot)
    assert shown(fn -> Console.arm(robot) end) == "#{name} is armed\n"
    assert shown(fn -> Console.arm(robot) end) =~ "already_armed"
    assert shown(fn -> Console.disarm(robot) end) == "#{name} is disarmed\n"
    shown(fn -> Console.arm(robot) end)
    assert shown(fn -> Console.estop(robot) end) =~ "#{name} is disarmed\narming is forbidden"
    assert shown(fn -> Console.arm(robot) end) =~ "console/estop forbids arming"
    assert shown(fn -> Console.release(robot) end) == "#{name} is disarmed\n"
    assert shown(fn -> Console.arm(robot) end) == "#{name} is armed\n"
  end

  @tag :tmp_dir
  test "firmware shows the guard, and why the firmware before was reverted", %{tmp_dir: folder} do
    text = shown(fn -> Console.firmware(:no_guard, folder) end)
    assert text =~ ~r/validation +unknown/ and text =~ ~r/guard +is not running/

    report = %{
      outcome: :reverted,
      at: DateTime.utc_now(),
      firmware: %{},
      reasons: [ring: :never],
      missing: []
    }

    :ok = BB.Firmware.Guard.Report.write(folder, report)

    assert shown(fn -> Console.firmware(:no_guard, folder) end) =~
             "required: ring: was never good"
  end

  test "i2c_scan shows who answers" do
    bus = "console-#{System.unique_integer([:positive])}"

    # The second one answers no reading of a single byte.
    devices = %{0x68 => {BB.Bus.Sim.Mpu6050, []}, 0x40 => {BB.Bus.Sim.Ina219, []}}
    start_supervised!({BB.Bus.Sim, buses: %{bus => [devices: devices]}})

    assert shown(fn -> Console.i2c_scan(bus) end) =~ ~r/#{bus} +0x40 0x68\n/
    assert shown(fn -> Console.i2c_scan("no-such-bus") end) =~ "cannot be opened: :bus_not_found"
  end

  test "nothing raises when the robot is not started, or what is asked for is nonsense" do
    for fun <- [
          &Console.sensors/1,
          &Console.health/1,
          &Console.topics/1,
          &Console.params([], &1),
          &Console.watch([:sensor], robot: &1),
          &Console.arm/1,
          &Console.disarm/1,
          &Console.release/1
        ],
        robot <- [NoRobot, "no robot", nil] do
      text = capture_io(fn -> assert fun.(robot) == :"do not show this result in output" end)
      assert text =~ ~r/that did not work|refused|none|NoRobot is disarmed/
    end

    assert capture_io(fn -> Console.watch(:nonsense, seconds: -1) end) =~ "that did not work"
    assert capture_io(fn -> Console.i2c_scan(:nonsense) end) != ""
  end

  test "the rows of the message of the day tell of the robot, also of one that is not started", %{
    robot: robot
  } do
    assert [[{"Robot", "disarmed"}, {"Sensors", "1 of 2 up"}], [{"Firmware", "unknown"}]] =
             Console.motd_rows(robot)

    assert [[_, {"Sensors", "not running"}], _] = Console.motd_rows(NoRobot)
  end

  test "no name of the console's is one of IEx's helpers" do
    names = &MapSet.new(Keyword.keys(&1))
    ours = names.(Console.__info__(:functions))
    assert MapSet.disjoint?(ours, names.(IEx.Helpers.__info__(:functions)))
    assert MapSet.disjoint?(ours, names.(IEx.Helpers.__info__(:macros)))
  end

  test "the board's iex.exs runs where only the console is there" do
    code =
      "import IEx.Helpers\n" <>
        File.read!("rootfs_overlay/etc/iex.exs") <> "\nfirmware(:no_guard)"

    assert capture_io(fn -> Code.eval_string(code) end) =~ "guard"
  end

  defp publish_for_ever(robot) do
    BB.publish(robot, [:sensor, :base_link, :range], range())
    Process.sleep(10)
    publish_for_ever(robot)
  end
end

defmodule Ganglion.ConsoleTest do
  # The simulated buses, the configuration and the names of the guard are those of the VM.
  use ExUnit.Case, async: false

  import BB.Test.Eventually

  doctest Ganglion.Console.Rows
  import BB.Test.Robot
  import ExUnit.CaptureIO

  alias BB.Firmware.Board.Memory
  alias BB.Firmware.Trial
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

  # The output of a function; every line fits a terminal, and arrives over `ssh host '…'` too.
  defp shown(fun) do
    text = capture_io(fn -> assert fun.() == :ok end)
    for line <- String.split(text, "\n"), do: assert(String.length(line) <= 80, line)
    refute text =~ "command failed"
    assert for(<<char <- text>>, char not in 0x20..0x7E and char != ?\n, do: char) == [], text
    text
  end

  test "sensors and health show each sensor and its error", %{robot: robot} do
    BB.publish(robot, [:sensor, :base_link, :range], range())
    assert shown(fn -> Console.sensors(robot) end) =~ ~r/range +up +\d+\.\d +- +\d+ ms +0/
    assert shown(fn -> Console.sensors(robot) end) =~ ~r/\nquiet: {:a_very_long_reason,\n/
    health = shown(fn -> Console.health(robot) end)
    assert health =~ ~r/quiet +no +backoff +\d+ +{:a_very_long/
    assert health =~ ~r/range +yes +up/
  end

  test "topics shows the streams", %{robot: robot} do
    BB.publish(robot, [:sensor, :base_link, :range], range())
    assert shown(fn -> Console.topics(robot) end) =~ ~r"sensor/base_link/range +Sensor.Range"
  end

  test "watch shows messages, and leaves none in the mailbox", %{
    robot: robot
  } do
    {:ok, publisher} = Task.start_link(fn -> publish_for_ever(robot) end)
    text = shown(fn -> Console.watch([:sensor], seconds: 0.2, robot: robot) end)
    Process.unlink(publisher)
    Process.exit(publisher, :kill)

    assert text =~
             ~r/sensor\/base_link\/range field_of_view 0.1, max_range 1.5, .*\s+radiation_type infrared, range 0.4/

    assert text =~ "watched for 0.2 s"
    assert BB.PubSub.subscribers(robot, [:sensor]) == []
  end

  test "ring shows the topics in shared memory" do
    topic = BB.Test.Native.topic("console")
    {:ok, publisher} = BB.Ring.Publisher.open(topic)
    # A name as long as a test's topic is cut.
    shown_name = topic |> String.slice(0, 12) |> Regex.escape()
    assert shown(fn -> Console.ring() end) =~ ~r/^#{shown_name}\S* +live +0 +16/m
    BB.Ring.Publisher.close(publisher)
  end

  test "params shows values and defaults", %{robot: robot} do
    :ok = BB.Parameter.set(robot, [:debug], true)
    assert shown(fn -> Console.params([], robot) end) =~ ~r/debug +true +false +:boolean/
  end

  test "arm, disarm, estop and release print the new state", %{robot: robot} do
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

  describe "revert" do
    @describetag :tmp_dir

    setup %{tmp_dir: folder} do
      {:ok, memory} =
        Memory.start_link(
          status: :validated,
          tell: self(),
          firmware: %{"nerves_fw_uuid" => "new", "nerves_fw_version" => "2.0.0"},
          other: %{"nerves_fw_uuid" => "old", "nerves_fw_version" => "1.0.0"}
        )

      Application.put_env(:ganglion, :board, {Memory, memory})
      on_exit(fn -> Application.delete_env(:ganglion, :board) end)
      %{memory: memory, board: {Memory, memory}, folder: folder}
    end

    test "starts the previous firmware, and records it in the story", %{folder: folder} do
      assert shown(fn -> Console.revert(folder) end) =~ "restarts with the firmware 1.0.0"
      assert_receive {Memory, :revert}
      text = shown(fn -> Console.firmware(:no_guard, folder) end)
      assert text =~ ~r/other slot +1.0.0/
      assert text =~ "by a person, on the console"
      assert text =~ "nerves_fw_version 2.0.0"
      assert text =~ ~r/latest events:\n.*is reverted\s+by a\s+person/
    end

    test "never starts firmware that failed its trial", context do
      %{folder: folder, board: board} = context
      old = start_firmware("old", :unvalidated)
      assert :ok = Trial.begin(folder, old, "first")
      assert :ok = Trial.begin(folder, board, "second")
      assert_receive {Memory, :prevent_revert}, 30_000

      assert Trial.refused?(folder, "old")
      assert shown(fn -> Console.revert(folder) end) =~ "the other slot has no firmware"
      # The slot may still have the firmware, if the board could not close it.
      put_other(context.memory, %{"nerves_fw_uuid" => "old", "nerves_fw_version" => "1.0.0"})
      assert shown(fn -> Console.revert(folder) end) =~ "refused: the firmware 1.0.0 in the other"
      assert shown(fn -> Console.firmware(:no_guard, folder) end) =~ "1.0.0, which was refused"
      refute_received {Memory, :revert}
    end

    test "is refused while a robot is armed", %{robot: robot, folder: folder} do
      :ok = BB.Safety.arm(robot)
      assert shown(fn -> Console.revert(folder) end) =~ "refused: a robot is armed"
      refute_received {Memory, :revert}
    end

    test "reports a board that fails to revert", %{memory: memory, folder: folder} do
      Memory.answer(memory, :revert, {:error, :enospc})
      assert shown(fn -> Console.revert(folder) end) =~ "did not revert: no space left on device"
    end

    defp start_firmware(uuid, status) do
      firmware = %{"nerves_fw_uuid" => uuid, "nerves_fw_version" => "1.0.0"}
      {:ok, memory} = Memory.start_link(status: status, firmware: firmware)
      {Memory, memory}
    end

    defp put_other(memory, other), do: Agent.update(memory, &%{&1 | other: other})
  end

  @tag :tmp_dir
  test "firmware shows the guard, and the report of the reverted firmware", %{tmp_dir: folder} do
    text = shown(fn -> Console.firmware(:no_guard, folder) end)
    assert text =~ ~r/validation +unknown/ and text =~ ~r/guard +is not running/

    report = %{
      outcome: :reverted,
      at: DateTime.utc_now(),
      firmware: %{},
      reasons: [ring: :never],
      missing: []
    }

    :ok = BB.Firmware.Trial.Findings.write(folder, report)

    assert shown(fn -> Console.firmware(:no_guard, folder) end) =~
             "required: ring: was never good"
  end

  test "i2c_scan shows the addresses that answer" do
    bus = "console-#{System.unique_integer([:positive])}"

    # The second device does not answer a read of a single byte.
    devices = %{0x68 => {BB.Bus.Sim.Mpu6050, []}, 0x40 => {BB.Bus.Sim.Ina219, []}}
    start_supervised!({BB.Bus.Sim, buses: %{bus => [devices: devices]}})

    assert shown(fn -> Console.i2c_scan(bus) end) =~ ~r/#{bus} +0x40 0x68\n/
    assert shown(fn -> Console.i2c_scan("no-such-bus") end) =~ "cannot be opened: :bus_not_found"
  end

  defmodule FullBus do
    def open(_bus, _opts), do: {:error, {:errno, 28}}
    def bus_names, do: ["full"]
  end

  test "an error of the kernel is explained" do
    before = Application.get_env(:ganglion, :i2c)
    Application.put_env(:ganglion, :i2c, FullBus)
    on_exit(fn -> Application.put_env(:ganglion, :i2c, before) end)
    assert shown(fn -> Console.i2c_scan("full") end) =~ "no space left on device"
  end

  test "nothing raises for a robot that is not started or invalid arguments" do
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
      text = capture_io(fn -> assert fun.(robot) == :ok end)
      assert text =~ ~r/command failed|refused|none|NoRobot is disarmed/
    end

    assert capture_io(fn -> Console.watch(:nonsense, seconds: -1) end) =~ "command failed"
    assert capture_io(fn -> Console.i2c_scan(:nonsense) end) != ""
  end

  test "the message of the day has rows for the robot, also if it is not started", %{
    robot: robot
  } do
    assert [[{"Robot", "disarmed"}, {"Sensors", "1 of 2 up"}], [{"Guard", "not running"}]] =
             Console.motd_rows(robot)

    assert [[{"Robot", "not running"}, {"Sensors", "not running"}], _] =
             Console.motd_rows(NoRobot)
  end

  test "no row of the message of the day has the label of one of Nerves' rows" do
    labels = for row <- Console.motd_rows(), {label, _text} <- row, do: label
    nerves = ["Serial", "Uptime", "Clock", "Firmware", "Applications", "Memory usage"]
    nerves = nerves ++ ["Part usage", "Load average", "Temperature", "Hostname", "Platform"]
    assert labels -- nerves == labels
    for label <- labels, do: assert(String.length(label) <= 12)
  end

  test "IEx hides the result, and other callers get :ok", %{robot: robot} do
    assert capture_io(fn -> assert Console.sensors(robot) == :ok end) =~ "range"

    capture_io(fn ->
      Process.put(:iex_server, self())
      assert Console.sensors(robot) == IEx.dont_display_result()
    end)
  end

  test "watch shows the numbers of an inertial measurement unit", %{robot: robot} do
    imu =
      BB.Message.new!(BB.Message.Sensor.Imu, :imu,
        orientation: BB.Math.Quaternion.identity(),
        angular_velocity: BB.Math.Vec3.new(0.0125, 0.0, -1.5),
        linear_acceleration: BB.Math.Vec3.new(0.0, 0.0, 9.81)
      )

    text = watched(robot, [:sensor, :base_link, :imu], imu)
    assert text =~ "angular_velocity 0.0125 0.0 -1.5"
    assert text =~ ~r/linear_acceleration\s+0.0\s+0.0\s+9.81/
  end

  # The message is published once it is watched.
  defp watched(robot, path, message) do
    test = self()

    {:ok, publisher} =
      Task.start_link(fn ->
        eventually(fn -> BB.PubSub.subscribers(robot, path) != [] end)
        BB.publish(robot, path, message)
        send(test, :published)
      end)

    text = shown(fn -> Console.watch(path, seconds: 1, robot: robot) end)
    assert_receive :published, 30_000
    Process.unlink(publisher)
    text
  end

  test "no function of the console has the name of an IEx helper" do
    names = &MapSet.new(Keyword.keys(&1))
    ours = names.(Console.__info__(:functions))
    assert MapSet.disjoint?(ours, names.(IEx.Helpers.__info__(:functions)))
    assert MapSet.disjoint?(ours, names.(IEx.Helpers.__info__(:macros)))
  end

  test "the board's iex.exs runs if only the console is available" do
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

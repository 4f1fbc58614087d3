defmodule ReleaseTest do
  @moduledoc """
  A release of the host, the nearest thing to a board's image that every machine can run: what `mix release` makes is started,
  asked and stopped by its own commands. `bin/test release` runs this, `mix test` leaves it out, for it builds all in `prod`.
  """

  # The topics of the robot that ships are the machine's own.
  use ExUnit.Case, async: false

  import BB.Test.Eventually

  alias BB.Test.Native

  @moduletag :release
  @moduletag timeout: 900_000

  @folder Path.expand("_build/release_test")
  @start_ms 60_000
  @stop_ms 30_000

  setup_all do
    # What Mix exports to its children is of `test`.
    build = [env: [{"MIX_ENV", "prod"}, {"MIX_BUILD_PATH", nil}], stderr_to_stdout: true]
    assert {_, 0} = System.cmd("mix", ["release", "--quiet", "--path", @folder], build)
    :ok
  end

  setup do
    node = "ganglion_test_#{System.pid()}_#{System.unique_integer([:positive])}"
    assert {_, 0} = command(node, ["daemon"])
    os_pid = eventually(fn -> pid(node) end, @start_ms)
    on_exit(fn -> Native.end_by_force(os_pid) end)
    eventually(fn -> rpc(node, "IO.write(Process.whereis(Ganglion.Robot) != nil)") == "true" end)
    %{node: node, os_pid: os_pid}
  end

  test "the robot publishes from its start, by the drivers and by the native programs", %{
    node: node
  } do
    assert heard(node, [:sensor, :base_link, :imu]) == "BB.Message.Sensor.Imu"

    assert heard(node, [:sensor, :base_link, :camera_mount, :camera_link, :tags]) ==
             "BB.Message.Vision.TagDetections"
  end

  test "guard, gate and network watch over the robot, and the console shows them", %{node: node} do
    assert rpc(node, "IO.inspect(BB.Firmware.Guard.state())") =~ "phase: :settled"
    assert rpc(node, "IO.write(elem(BB.Firmware.Gate.precheck(), 1))") =~ "public key"
    assert rpc(node, "Ganglion.Console.sensors()") =~ ~r/imu +up +\d+\.\d/
  end

  test "remote is a console on the running robot", %{node: node} do
    # A shell between, because a port cannot end the input of what it has started.
    input = "IO.puts([\"the robot is \", to_string(BB.Safety.state(Ganglion.Robot))])\\n"
    shell = "printf '#{input}' | #{Path.join(@folder, "bin/ganglion")} remote"
    {text, 0} = System.cmd("sh", ["-c", shell], options(node))
    assert text =~ "the robot is disarmed"
    assert pid(node)
  end

  test "stop ends the robot and leaves no process behind", %{node: node, os_pid: os_pid} do
    programs = eventually(fn -> native_programs(os_pid) end)
    assert {_, 0} = command(node, ["stop"])
    for pid <- [os_pid | programs], do: eventually(fn -> not Native.running?(pid) end, @stop_ms)
  end

  # What is published there next: the name of its payload, told by the release itself.
  defp heard(node, path) do
    rpc(node, """
    {:ok, _} = BB.subscribe(Ganglion.Robot, #{inspect(path)}, exact: true)
    receive do
      {:bb, _, message} -> IO.write(inspect(message.payload.__struct__))
    after
      30_000 -> Ganglion.Console.health()
    end
    """)
  end

  defp rpc(node, code) do
    {text, _status} = command(node, ["rpc", code])
    text
  end

  defp pid(node) do
    case command(node, ["pid"]) do
      {text, 0} -> text |> String.trim() |> String.to_integer()
      _not_yet -> nil
    end
  end

  # Camera, detector, and the guard of each, once all of them run.
  defp native_programs(os_pid) do
    pids = Native.descendants(os_pid)
    names = for pid <- pids, {:ok, name} <- [File.read("/proc/#{pid}/comm")], do: name
    if "camera\n" in names and "vision_tags\n" in names, do: pids
  end

  defp command(node, args),
    do: System.cmd(Path.join(@folder, "bin/ganglion"), args, options(node))

  defp options(node) do
    env = [
      {"RELEASE_NODE", node},
      {"RELEASE_TMP", Path.join([@folder, "tmp", node])},
      {"LC_ALL", "C.UTF-8"}
    ]

    [env: env, stderr_to_stdout: true]
  end
end

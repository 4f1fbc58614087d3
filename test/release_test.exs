defmodule ReleaseTest do
  @moduledoc """
  Tests a release on the host, which is similar to a board's image: `mix release` builds it, and
  its own commands start, query and stop it. `bin/test release` runs this test; `mix test` skips
  it, because it builds everything in `prod`.
  """

  use ExUnit.Case, async: false

  import BB.Test.Eventually

  alias BB.Test.{Native, Run}

  @moduletag :release
  @moduletag timeout: 900_000

  # The robot that ships has fixed topics, so that this run has a folder for them.
  setup_all do
    folder = Path.join(System.tmp_dir!(), Run.unique("release"))
    topics = Path.join("/dev/shm", Run.unique("release"))
    File.mkdir!(topics)
    on_exit(fn -> Enum.each([folder, topics], &File.rm_rf!/1) end)
    # Mix exports variables of `test` to its children.
    build = [env: [{"MIX_ENV", "prod"}, {"MIX_BUILD_PATH", nil}], stderr_to_stdout: true]
    assert {_, 0} = System.cmd("mix", ["release", "--quiet", "--path", folder], build)
    %{folder: folder, topics: topics}
  end

  setup %{folder: folder, topics: topics} do
    name = String.replace(Run.unique("ganglion"), ".", "_")
    node = %{name: name, folder: folder, topics: topics}
    assert {_, 0} = command(node, ["daemon"])
    os_pid = eventually(fn -> pid(node) end)
    on_exit(fn -> Native.end_by_force(os_pid) end)
    eventually(fn -> rpc(node, "IO.write(Process.whereis(Ganglion.Robot) != nil)") == "true" end)
    %{node: node, os_pid: os_pid}
  end

  test "the robot publishes from its start, from drivers and native programs", %{
    node: node
  } do
    assert heard(node, [:sensor, :base_link, :imu]) == "BB.Message.Sensor.Imu"

    assert heard(node, [:sensor, :base_link, :camera_mount, :camera_link, :tags]) ==
             "BB.Message.Vision.TagDetections"
  end

  test "guard, gate and network run, and the console shows the robot", %{node: node} do
    assert rpc(node, "IO.inspect(BB.Firmware.Guard.state())") =~ "phase: :settled"
    assert rpc(node, "IO.write(elem(BB.Firmware.Gate.precheck(), 1))") =~ "public key"
    assert rpc(node, "Ganglion.Console.sensors()") =~ ~r/imu +up +\d+\.\d/
  end

  test "remote is a console on the running robot", %{node: node} do
    # A shell in between, because a port cannot close the input of its process.
    input = "IO.puts([\"the robot is \", to_string(BB.Safety.state(Ganglion.Robot))])\\n"
    shell = "printf '#{input}' | #{Path.join(node.folder, "bin/ganglion")} remote"
    {text, 0} = System.cmd("sh", ["-c", shell], options(node))
    assert text =~ "the robot is disarmed"
    assert pid(node)
  end

  test "stop ends the robot and leaves no process behind", %{node: node, os_pid: os_pid} do
    programs = eventually(fn -> native_programs(os_pid) end)
    assert {_, 0} = command(node, ["stop"])
    for pid <- [os_pid | programs], do: eventually(fn -> not Native.running?(pid) end)
  end

  # The next message there: the name of its payload, from the release itself.
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

  # Camera, detector and their guards, once all of them run.
  defp native_programs(os_pid) do
    pids = Native.descendants(os_pid)
    names = for pid <- pids, {:ok, name} <- [File.read("/proc/#{pid}/comm")], do: name
    if "camera\n" in names and "vision_tags\n" in names, do: pids
  end

  defp command(node, args),
    do: System.cmd(Path.join(node.folder, "bin/ganglion"), args, options(node))

  defp options(node) do
    env = [
      {"RELEASE_NODE", node.name},
      {"RELEASE_TMP", Path.join([node.folder, "tmp", node.name])},
      {"CONDUIT_RING_DIR", node.topics},
      {"LC_ALL", "C.UTF-8"}
    ]

    [env: env, stderr_to_stdout: true]
  end
end

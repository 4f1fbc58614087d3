defmodule BB.Sensor.NativeProcessTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Native
  import BB.Test.Robot
  import ExUnit.CaptureLog

  alias BB.Message.Sensor.Status

  doctest BB.Sensor.NativeProcess

  # A robot whose one sensor is a shell script; `marker` tells its processes from others'.
  defp shell_robot(script, opts \\ []) do
    marker = BB.Test.Run.unique("marker")
    opts = [program: "sh", args: ["-c", script, marker]] ++ opts

    robot =
      create(
        quote do
          sensors do
            sensor :shell, {BB.Sensor.NativeProcess, unquote(Macro.escape(opts))}
          end
        end
      )

    {robot, marker}
  end

  defp start!({robot, marker}) do
    pid = start_supervised!(robot)
    {robot, marker, pid}
  end

  defp guarded(marker), do: processes("process_guard", marker)
  defp running(marker), do: processes("sh", marker)

  test "the program starts with its sensor" do
    {_robot, marker, _} = start!(shell_robot("sleep 600; :"))
    assert [_] = eventually(fn -> one(running(marker)) end)
  end

  test "it is given its topics as options, then its arguments" do
    robot =
      create(
        quote do
          sensors do
            sensor :echo,
                   {BB.Sensor.NativeProcess,
                    program: "echo", topics: [frames: "a", raw_imu: "b"], args: ["-x", "1"]}
          end
        end
      )

    log =
      capture_log(fn ->
        start_supervised!(robot)
        eventually(fn -> health(robot, :echo).restarts > 0 end)
      end)

    assert log =~ "echo: --frames a --raw-imu b -x 1"
  end

  test "what it prints goes to the log under the sensor's name, long lines whole" do
    long = String.duplicate("x", 5000)

    log =
      capture_log(fn ->
        {robot, _, _} = start!(shell_robot("echo out; echo err >&2; echo #{long}; exit 3"))
        eventually(fn -> health(robot, :shell).restarts > 0 end)
      end)

    assert log =~ "shell: out\n"
    assert log =~ "shell: err\n"
    assert log =~ "shell: #{long}\n"
  end

  test "its end is told with the exit status, and it is started again" do
    {robot, marker} = shell_robot("exec sleep 600")
    start_supervised!(robot)
    {:ok, _} = BB.subscribe(robot, [:sensor_status, :shell])
    [os_pid] = eventually(fn -> guarded_program(marker) end)
    kill_9(os_pid)

    assert_receive {:bb, [:sensor_status, :shell],
                    %{payload: %Status{state: :backoff, reason: reason, retry_in_ms: ms}}}

    assert inspect(reason) =~ "exit_status, 137"
    assert ms <= 100

    assert_receive {:bb, [:sensor_status, :shell], %{payload: %Status{state: :up, restarts: 1}}}

    assert [new] = eventually(fn -> guarded_program(marker) end)
    assert new != os_pid
  end

  test "a program that does not exist is a reason, not a crash" do
    robot =
      create(
        quote do
          sensors do
            sensor :nothing, {BB.Sensor.NativeProcess, program: "no_such_program"}
          end
        end
      )

    start_supervised!(robot)

    assert %{reason: reason} =
             eventually(fn -> (h = health(robot, :nothing)).state == :backoff && h end)

    assert inspect(reason) =~ "no_such_program"
  end

  test "when its sensor stops, the program and all that it started are gone" do
    {robot, marker, _} = start!(shell_robot("sleep 600 & setsid sleep 600 & sleep 600; :"))
    guards = eventually(fn -> one(running(marker)) && one(guarded(marker)) end)
    tree = eventually(fn -> (pids = descendants(hd(guards))) && length(pids) >= 4 && pids end)
    stop_supervised!(robot)
    for pid <- guards ++ tree, do: refute(running?(pid))
  end

  test "a program that ignores SIGTERM is killed after the grace" do
    {robot, marker, _} =
      start!(shell_robot("trap '' TERM; while :; do sleep 0.05; done", grace_ms: 50))

    [os_pid] = eventually(fn -> one(running(marker)) end)
    stop_supervised!(robot)
    refute running?(os_pid)
  end

  test "when its sensor's process is killed, the program ends too and comes back" do
    {robot, marker, _} = start!(shell_robot("sleep 600; :"))
    [os_pid] = eventually(fn -> one(running(marker)) end)
    robot |> BB.Process.whereis(:shell) |> Process.exit(:kill)
    eventually(fn -> not running?(os_pid) end)
    [new] = eventually(fn -> one(running(marker)) end)
    assert new != os_pid
  end

  test "wrong options fail the start of the robot" do
    {robot, _} = shell_robot("", grace_ms: -1)
    assert {:error, %BB.Options.ValidationError{} = error} = robot.start_link()
    assert Exception.message(error) =~ "grace_ms"
  end

  # Between fork and exec a process still looks like the one that it came from.
  defp one(pids), do: if(match?([_], pids), do: pids)

  # A program that the shell became by exec no longer shows the marker; its guard does.
  defp guarded_program(marker) do
    with [guard] <- guarded(marker),
         [_ | _] = pids <- descendants(guard),
         do: pids,
         else: (_ -> nil)
  end
end

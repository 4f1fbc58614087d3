defmodule BB.Sensor.NativeProcessTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Mistake
  import BB.Test.Native
  import BB.Test.Robot
  import ExUnit.CaptureLog

  alias BB.Message.Sensor.Status

  alias BB.Sensor.NativeProcess.Program

  doctest BB.Sensor.NativeProcess
  doctest BB.Sensor.NativeProcess.Guard
  doctest BB.Sensor.NativeProcess.Program
  doctest BB.Sensor.NativeProcess.Topics

  # A robot whose only sensor is a shell script. `marker` identifies its processes.
  defp shell_robot(script, opts \\ []) do
    marker = BB.Test.Run.unique("marker")
    {name, opts} = Keyword.pop(opts, :name, :shell)
    opts = [program: "sh", args: ["-c", script, marker]] ++ opts

    robot =
      create(
        quote do
          sensors do
            sensor unquote(name), {BB.Sensor.NativeProcess, unquote(Macro.escape(opts))}
          end
        end
      )

    {robot, marker}
  end

  defp start!({robot, marker}) do
    pid = start_supervised!(robot)
    {robot, marker, pid}
  end

  # All processes below a guard, as soon as there are `count`.
  defp grown(guard, count) do
    eventually(fn ->
      pids = descendants(guard)
      length(pids) >= count && pids
    end)
  end

  defp guarded(marker), do: processes("process_guard", marker)
  defp running(marker), do: processes("sh", marker)

  test "the program starts with its sensor" do
    {_robot, marker, _} = start!(shell_robot("sleep 600; :"))
    assert [_] = eventually(fn -> one(running(marker)) end)
  end

  test "its command line has its topics as options, then its arguments" do
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

  test "its output is logged under the sensor's name, lines up to 4 KiB whole" do
    long = String.duplicate("x", 4096)

    log =
      capture_log(fn ->
        {robot, _, _} = start!(shell_robot("echo out; echo err >&2; echo #{long}; exit 3"))
        eventually(fn -> health(robot, :shell).restarts > 0 end)
      end)

    assert log =~ "shell: out\n"
    assert log =~ "shell: err\n"
    assert log =~ "shell: #{long}\n"
  end

  test "its exit is a reason with the exit status, and it is restarted" do
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

  describe "program:" do
    @describetag :tmp_dir

    # Executables that print their names.
    defp script(dir, name, mode \\ 0o755) do
      path = Path.join(dir, name)
      File.write!(path, "#!/bin/sh\necho this is #{name}\n")
      File.chmod!(path, mode)
      path
    end

    # An application with a program in its priv/bin, as in a release.
    defp application(dir) do
      app = :"app_#{System.unique_integer([:positive])}"
      folder = Path.join([dir, to_string(app), "priv", "bin"])
      File.mkdir_p!(folder)
      ebin = Path.join([dir, to_string(app), "ebin"])
      File.mkdir_p!(ebin)
      Code.append_path(ebin)
      on_exit(fn -> Code.delete_path(ebin) end)
      {app, folder}
    end

    defp with_program(program) do
      create(
        quote do
          sensors do
            sensor :detector,
                   {BB.Sensor.NativeProcess, program: unquote(Macro.escape(program))}
          end
        end
      )
    end

    defp printed(program) do
      capture_log(fn ->
        robot = with_program(program)
        start_supervised!(robot)
        eventually(fn -> health(robot, :detector).restarts > 0 end)
        stop_supervised!(robot)
      end)
    end

    defp refused(program) do
      robot = with_program(program)
      start_supervised!(robot)
      row = eventually(fn -> (h = health(robot, :detector)).state == :backoff && h end)
      stop_supervised!(robot)
      row.error
    end

    def detector(place), do: place
    def failing, do: raise("no detector today")

    test "is the priv/bin of any application", %{tmp_dir: dir} do
      {app, folder} = application(dir)
      path = script(folder, "detector")
      assert Program.find({app, "detector"}) == {:ok, path}
      assert printed({app, "detector"}) =~ "detector: this is detector"
    end

    test "is a path, or a name in PATH", %{tmp_dir: dir} do
      path = script(dir, "by_path")
      assert Program.find(path) == {:ok, path}
      assert {:ok, shell} = Program.find("sh")
      assert Path.basename(shell) == "sh"
      assert {:ok, camera} = Program.find("camera")
      assert camera == Application.app_dir(:ganglion, "priv/bin/camera")
    end

    test "is a function that returns one of these at the start", %{tmp_dir: dir} do
      {app, folder} = application(dir)
      path = script(folder, "detector")

      for place <- [{app, "detector"}, path] do
        assert Program.find({__MODULE__, :detector, [place]}) == {:ok, path}
        assert Program.find(fn -> place end) == {:ok, path}
      end

      assert printed({__MODULE__, :detector, [path]}) =~ "detector: this is detector"
    end

    test "that cannot be run is a reason with its remedy", %{tmp_dir: dir} do
      {app, folder} = application(dir)
      path = script(folder, "detector", 0o644)
      File.mkdir_p!(Path.join(folder, "a_folder"))

      for {program, words} <- [
            {path, "#{path} is not executable: run chmod +x #{path}"},
            {{app, "detector"}, "#{path} is not executable"},
            {{app, "detektor"}, "program detektor is not in the priv/bin of #{inspect(app)}"},
            {{app, "a_folder"}, "program a_folder is not in the priv/bin"},
            {{:rovr, "detector"}, "application :rovr is unknown: correct its name"},
            {"/nowhere/detector", "program /nowhere/detector does not exist: correct its path"},
            {{__MODULE__, :detector, [42]}, "returned 42, expected a name, a path"},
            {{__MODULE__, :failing, []}, "no detector today"}
          ] do
        assert refused(program) =~ words
      end
    end

    test "of another type fails the start of the robot" do
      for wrong <- [:detector, "", {"rover", "detector"}, {:rover, :detector}, {nil, "x"}, [1]] do
        assert {:error, error} = with_program(wrong).start_link()
        assert Exception.message(error) =~ ~s(expected a name, a path, {:my_app, "name"})
        assert Exception.message(error) =~ inspect(wrong)
      end
    end
  end

  test "when its sensor stops, the program and all its processes have exited" do
    {robot, marker, _} = start!(shell_robot("sleep 600 & setsid sleep 600 & sleep 600; :"))
    guards = eventually(fn -> one(running(marker)) && one(guarded(marker)) end)

    tree = grown(hd(guards), 4)

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

  test "when its sensor's process is killed, the program ends too and is restarted" do
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

  describe "a program that prints" do
    @describetag :tmp_dir

    # It prints, makes a file when it has printed all, and runs on.
    defp printing(dir, name, script) do
      {robot, marker} =
        shell_robot("#{script}; touch '#{dir}/#{name}'; exec sleep 600", name: name)

      start_supervised!(robot)
      {robot, marker, fn -> File.exists?("#{dir}/#{name}") end}
    end

    test "without an end of line is cut, and no memory stays in use", %{tmp_dir: dir} do
      log =
        capture_log(fn ->
          {robot, _, printed?} =
            printing(dir, :endless, "head -c 100000000 /dev/zero | tr '\\0' x; echo")

          eventually(printed?, 60_000)
          assert memory(BB.Process.whereis(robot, :endless)) < 2_000_000
          stop_supervised!(robot)
        end)

      lines = lines(log, "endless")
      assert Enum.all?(lines, &(byte_size(&1) <= 4096))
      assert hd(lines) == String.duplicate("x", 4096)
      assert accounted(lines) == ceil(100_000_000 / 4096)
    end

    test "a progress bar is logged state by state" do
      log =
        capture_log(fn ->
          script = "printf '\\r1 %%\\r2 %%\\r\\n3 %%\\n'; exit 3"
          {robot, _, _} = start!(shell_robot(script, name: :bar))
          eventually(fn -> health(robot, :bar).restarts > 0 end)
        end)

      assert ["1 %", "2 %", "3 %" | _] = lines(log, "bar")
    end

    test "too much has lines left out, which the log counts; the mailbox stays short", %{
      tmp_dir: dir
    } do
      log =
        capture_log(fn ->
          {robot, _, printed?} = printing(dir, :storm, "seq 300000")
          longest = watch_mailbox(BB.Process.whereis(robot, :storm))
          eventually(printed?, 60_000)
          assert longest.() <= 200
          assert health(robot, :storm).state == :up
          stop_supervised!(robot)
        end)

      lines = lines(log, "storm")
      assert ["1", "2", "3" | _] = lines
      assert length(lines) < 30_000
      assert accounted(lines) == 300_000
      assert List.last(lines) == "300000"
    end

    test "and dies at once is logged to the last line, also in a storm" do
      log =
        capture_log(fn ->
          script = "seq 100000; echo panicked at last >&2; kill -SEGV $$"
          {robot, _, _} = start!(shell_robot(script, name: :crash))
          eventually(fn -> health(robot, :crash).restarts > 0 end, 60_000)
          assert {:exit_status, 139} = health(robot, :crash).last_error
        end)

      assert "panicked at last" in lines(log, "crash")
    end

    test "while it is being stopped is logged" do
      script = "trap 'echo good bye; exit 0' TERM; while :; do sleep 0.05; done"

      log =
        capture_log(fn ->
          {robot, marker, _} = start!(shell_robot(script, name: :polite, grace_ms: 10_000))
          [guard] = eventually(fn -> one(guarded(marker)) end)
          # The trap is set before it sleeps.
          eventually(fn -> length(descendants(guard)) == 2 end)
          stop_supervised!(robot)
        end)

      assert "good bye" in lines(log, "polite")
    end

    test "bytes that are no text are logged as text" do
      log =
        capture_log(fn ->
          {robot, _, _} = start!(shell_robot("printf 'a\\377b\\n'; exit 3", name: :bytes))
          eventually(fn -> health(robot, :bytes).restarts > 0 end)
        end)

      assert "a?b" in lines(log, "bytes")
    end
  end

  # The logged lines, and the counts of lines left out, under the name of its sensor.
  defp lines(log, name) do
    for [_, line] <- Regex.scan(~r/\[\w+\] +#{name}: (.*)\n/, log), do: line
  end

  # The numbers of the logged lines, and of those left out.
  defp accounted(lines) do
    for line <- lines, reduce: 0 do
      sum ->
        case Regex.run(~r/\A(\d+) lines were left out/, line) do
          [_, count] -> sum + String.to_integer(count)
          nil -> sum + 1
        end
    end
  end

  # The memory of a process, with its binaries, its mailbox and its port's queue.
  defp memory(pid) do
    :erlang.garbage_collect(pid)
    {:memory, heap} = Process.info(pid, :memory)
    {:binary, binaries} = Process.info(pid, :binary)
    {:links, links} = Process.info(pid, :links)
    ports = for port <- links, is_port(port), {_, size} = Port.info(port, :memory), do: size
    heap + Enum.sum(ports) + (binaries |> Enum.map(&elem(&1, 1)) |> Enum.sum())
  end

  # Measures the greatest length until it receives a request.
  defp watch_mailbox(pid) do
    watcher = spawn_link(fn -> look_at_mailbox(pid, 0) end)

    fn ->
      send(watcher, {:longest, self()})
      assert_receive {:longest, longest}, 30_000
      longest
    end
  end

  defp look_at_mailbox(pid, longest) do
    receive do
      {:longest, from} -> send(from, {:longest, longest})
    after
      1 ->
        {:message_queue_len, length} = Process.info(pid, :message_queue_len)
        look_at_mailbox(pid, max(longest, length))
    end
  end

  describe "a grace longer than five seconds" do
    test "delays the robot's end, so that nothing outlives the robot" do
      script = "trap '' TERM; setsid sleep 600 & while :; do sleep 0.05; done"
      {robot, marker, _} = start!(shell_robot(script, grace_ms: 6_500))
      [os_pid] = eventually(fn -> one(running(marker)) end)
      [guard] = eventually(fn -> one(guarded(marker)) end)

      tree = grown(guard, 2)

      stop_supervised!(robot)
      for pid <- [os_pid, guard | tree], do: refute(running?(pid))
    end

    test "is bounded" do
      {robot, _} = shell_robot("", grace_ms: 10_001)
      assert {:error, %BB.Options.ValidationError{} = error} = robot.start_link()
      assert Exception.message(error) =~ "grace_ms"
    end
  end

  # The grandchild leaves its group, session and parent, and in one case its environment.
  for {how, command} <- [{"daemonised", "setsid"}, {"bare", "env -i setsid"}] do
    describe "a guard that guards a #{how} grandchild" do
      @daemon "(#{command} sh -c 'exec sleep 600' &); sleep 600; :"

      for {signal, exit_status} <- [{"KILL", 137}, {"STOP", 137}] do
        test "and gets SIG#{signal} leaves nothing running, and the sensor goes down" do
          {robot, marker} = shell_robot(@daemon)
          start_supervised!(robot)
          {:ok, _} = BB.subscribe(robot, [:sensor_status, :shell])
          [guard] = eventually(fn -> one(guarded(marker)) end)

          tree = grown(guard, 3)

          signal(unquote(signal), guard)

          assert_receive {:bb, _, %{payload: %Status{state: :backoff, reason: reason}}}, 30_000
          assert reason == {:exit_status, unquote(exit_status)}
          for pid <- [guard | tree], do: refute(running?(pid))
          assert_receive {:bb, _, %{payload: %Status{state: :up}}}, 30_000
        end
      end

      test "and whose watch is killed leaves nothing running" do
        {robot, marker} = shell_robot(@daemon, grace_ms: 100)
        start_supervised!(robot)
        [guard] = eventually(fn -> one(guarded(marker)) end)
        [watch] = eventually(fn -> one(processes("process_watch", marker)) end)

        tree = grown(guard, 3)

        signal("KILL", watch)
        eventually(fn -> health(robot, :shell).restarts > 0 end, 30_000)
        for pid <- [guard | tree], do: refute(running?(pid))
      end
    end
  end

  test "a guard that is halted together with its watch does not outlive its sensor" do
    {robot, marker, _} = start!(shell_robot(@daemon, grace_ms: 50))
    [guard] = eventually(fn -> one(guarded(marker)) end)
    [watch] = eventually(fn -> one(processes("process_watch", marker)) end)

    tree = grown(guard, 3)

    # The watch first, since it would end the guard at once.
    for pid <- [watch, guard], do: signal("STOP", pid)
    stop_supervised!(robot)
    for pid <- [watch, guard | tree], do: refute(running?(pid))
  end

  describe "a program that a signal halts" do
    test "is killed, with a reason, and restarted" do
      {robot, marker} = shell_robot("exec sleep 600", halt_ms: 200)
      start_supervised!(robot)
      {:ok, _} = BB.subscribe(robot, [:sensor_status, :shell])
      [os_pid] = eventually(fn -> guarded_program(marker) end)
      signal("STOP", os_pid)
      assert_receive {:bb, _, %{payload: %Status{state: :backoff, reason: reason}}}, 30_000
      assert reason == {:halted, 200}
      assert BB.Sensor.explain(BB.Sensor.NativeProcess, reason) =~ "halted by a signal"
      refute running?(os_pid)
      assert_receive {:bb, _, %{payload: %Status{state: :up}}}, 30_000
      assert [new] = eventually(fn -> guarded_program(marker) end)
      assert new != os_pid
    end

    test "and continues in time runs on" do
      script = "kill -STOP $$; kill -KILL $$"
      {robot, marker} = shell_robot(script, halt_ms: 60_000)
      start_supervised!(robot)
      [os_pid] = eventually(fn -> one(running(marker)) end)
      eventually(fn -> state(os_pid) == "T" end)
      signal("CONT", os_pid)
      eventually(fn -> health(robot, :shell).restarts > 0 end)
      assert health(robot, :shell).last_error == {:exit_status, 137}
    end
  end

  describe "max_silence" do
    @describetag :tmp_dir

    # A shell that starts a camera, so that each may end without the other.
    defp camera_robot(dir, topic, max_silence, opts) do
      program = Path.join(dir, "wrapped_camera")
      camera = Application.app_dir(:ganglion, ["priv", "bin", "camera"])
      File.write!(program, "#!/bin/sh\n#{camera} \"$@\" --rate 100\nsleep 600; :\n")
      File.chmod!(program, 0o755)
      opts = [program: program, topics: [topic: topic]] ++ opts
      silent_robot(opts, max_silence)
    end

    defp silent_robot(opts, max_silence) do
      create(
        quote do
          sensors do
            sensor :camera, {BB.Sensor.NativeProcess, unquote(Macro.escape(opts))},
              required: true,
              max_silence: unquote(Macro.escape(max_silence))
          end
        end
      )
    end

    defp published(topic) do
      case BB.Ring.info(topic) do
        {:ok, %{published: count}} -> count
        {:error, _reason} -> 0
      end
    end

    for {how, publishes} <- [
          {"finds its topic by the writer", []},
          {"names its topic by its key", [publishes: [:topic]]}
        ] do
      test "of a program that publishes and #{how} does not pass", %{tmp_dir: dir} do
        topic = topic()
        robot = camera_robot(dir, topic, BB.Unit.new!(5, :second), unquote(publishes))
        start_supervised!(robot)
        {:ok, _} = BB.subscribe(robot, [:sensor_status], replay: true)
        eventually(fn -> published(topic) >= 700 end, 60_000)
        assert %{state: :up, restarts: 0} = health(robot, :camera)
        refute_received {:bb, _, %{payload: %Status{state: :stale}}}
      end
    end

    test "of a program that hangs passes; then it is ended and restarted", %{tmp_dir: dir} do
      topic = topic()
      robot = camera_robot(dir, topic, BB.Unit.new!(500, :millisecond), hang_ms: 3_000)
      start_supervised!(robot)
      {:ok, _} = BB.subscribe(robot, [:sensor_status])
      eventually(fn -> published(topic) >= 10 and health(robot, :camera).state == :up end, 60_000)
      {:ok, %{writer_pid: camera}} = BB.Ring.info(topic)
      [shell] = eventually(fn -> one(processes("sh", topic)) end)
      kill_9(camera)
      assert_receive {:bb, _, %{payload: %Status{state: :stale, reason: {:silent, 500}}}}, 30_000
      assert_receive {:bb, _, %{payload: %Status{state: :backoff, reason: reason}}}, 30_000
      assert reason == {:hung, 3_500}
      refute running?(shell)
      assert_receive {:bb, _, %{payload: %Status{state: :up}}}, 30_000
      before = published(topic)
      eventually(fn -> published(topic) > before end, 30_000)
    end

    # A program that takes any topics and publishes on none.
    defp reader(dir) do
      program = Path.join(dir, "reader")
      File.write!(program, "#!/bin/sh\nsleep 600; :\n")
      File.chmod!(program, 0o755)
      program
    end

    test "passes although others publish on the topics that it reads", %{tmp_dir: dir} do
      [frames, detections] = [topic("frames"), topic("detections")]
      {:ok, publisher} = BB.Ring.Publisher.open(frames)
      topics = [topics: [frames: frames, detections: detections]]

      for publishes <- [[], [publishes: [:detections]], [publishes: [detections]]] do
        options = [program: reader(dir)] ++ topics ++ publishes
        robot = silent_robot(options, BB.Unit.new!(200, :millisecond))
        start_supervised!(robot)

        eventually(
          fn ->
            :ok = BB.Ring.Publisher.publish(publisher, "frame")
            match?(%{state: :stale, reason: {:silent, 200}}, health(robot, :camera))
          end,
          30_000
        )
      end
    end

    test "of a program that only reads counts the topics it reads, and never ends it", %{
      tmp_dir: dir
    } do
      topic = topic()
      {:ok, publisher} = BB.Ring.Publisher.open(topic)
      options = [program: reader(dir), topics: [frames: topic], hang_ms: 0]
      robot = silent_robot(options, BB.Unit.new!(2, :second))
      start_supervised!(robot)
      {:ok, _} = BB.subscribe(robot, [:sensor_status])

      eventually(
        fn ->
          :ok = BB.Ring.Publisher.publish(publisher, "frame")
          published(topic) >= 800
        end,
        60_000
      )

      assert %{state: :up, restarts: 0} = health(robot, :camera)
      refute_received {:bb, _, %{payload: %Status{state: :stale}}}
      assert_receive {:bb, _, %{payload: %Status{state: :stale}}}, 30_000
      :ok = BB.Ring.Publisher.publish(publisher, "frame")
      assert_receive {:bb, _, %{payload: %Status{state: :up, restarts: 0}}}, 30_000
    end

    test "without a topic to measure is refused while the robot compiles" do
      for {options, words} <- [
            {~s(program: "sleep", args: ["600"]), ["no ring topic", "remove max_silence"]},
            {~s(program: "a", topics: [frames: "f"], publishes: []), ["no ring topic"]},
            {~s(program: "a", topics: [frames: "f"], publishes: [:tags]),
             ["got: :tags", "[:frames]"]}
          ] do
        error =
          mistake("""
          sensors do
            sensor :native, {BB.Sensor.NativeProcess, #{options}}, max_silence: ~u(1 second)
          end
          """)

        message = Exception.message(error)
        for word <- ["sensor :native: " | words], do: assert(message =~ word)
      end
    end
  end

  test "a published topic that is not declared is a reason" do
    {robot, _} = shell_robot("sleep 600", publishes: [:tags])
    start_supervised!(robot)
    row = eventually(fn -> (row = health(robot, :shell)).state == :backoff && row end)
    assert row.error =~ "publishes: :tags is no ring topic"
  end

  # Between fork and exec a process still looks like its parent.
  defp one(pids), do: if(match?([_], pids), do: pids)

  # After exec the program no longer shows the marker; its guard does.
  defp guarded_program(marker) do
    with [guard] <- guarded(marker),
         [_ | _] = pids <- descendants(guard),
         do: pids,
         else: (_ -> nil)
  end
end

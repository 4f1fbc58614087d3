defmodule BB.Firmware.ApplicationsTest do
  @moduledoc """
  Applications that are killed, as OTP's application controller sees and reports it. They are ones
  of the test: the project's own has the robots of other tests.
  """

  # Reports of starts are logged for debugging, so the logger's level is the VM's.
  use ExUnit.Case, async: false

  import BB.Test.Eventually

  alias BB.Firmware.Applications
  alias BB.Firmware.Applications.Restarter
  alias BB.Firmware.Board.Memory
  alias BB.Firmware.{Story, Trial}
  alias BB.Test.{Killed, Shoehorn}

  @moduletag :tmp_dir
  @moduletag :capture_log

  @pauses [pauses_ms: [0, 1, 1, 1], stay_ms: 1]

  # An application whose supervisor has the application's name; `fail: true` in its environment
  # keeps it from starting.
  defmodule App do
    use Application

    def start(_type, app) do
      if Application.get_env(app, :fail),
        do: {:error, :no_such_chip},
        else: Supervisor.start_link([], strategy: :one_for_one, name: app)
    end
  end

  setup context do
    level = Logger.level()
    Logger.configure(level: :debug)
    on_exit(fn -> Logger.configure(level: level) end)

    app = application([])
    dependent = application([app])
    {:ok, _} = Application.ensure_all_started(dependent)

    {:ok, memory} =
      Memory.start_link(
        status: :validated,
        tell: self(),
        firmware: %{"nerves_fw_uuid" => "running", "nerves_fw_version" => "1.0.0"}
      )

    Map.merge(
      %{app: app, dependent: dependent, memory: memory, folder: context.tmp_dir},
      restarter(context.tmp_dir, memory, [app, dependent], [])
    )
  end

  defp restarter(folder, memory, apps, opts) do
    own = [board: {Memory, memory}, folder: folder, expected: apps, gate: :no_gate]
    {:ok, restarter} = Restarter.start(opts ++ @pauses ++ own)
    on_exit(fn -> Process.exit(restarter, :kill) end)
    %{restarter: restarter, shoehorn: Shoehorn.start(Applications, restarter, apps)}
  end

  defp application(dependencies) do
    app = :"test_app_#{System.unique_integer([:positive])}"
    keys = [vsn: ~c"1", applications: [:kernel, :stdlib] ++ dependencies, mod: {App, app}]
    :ok = :application.load({:application, app, keys})

    on_exit(fn ->
      Application.stop(app)
      Application.unload(app)
    end)

    app
  end

  defp kill(app) do
    pid = eventually(fn -> Process.whereis(app) end, 30_000)
    ref = Process.monitor(pid)
    Process.exit(pid, :kill)
    assert_receive {:DOWN, ^ref, :process, ^pid, _}, 30_000
  end

  defp running?(app), do: List.keymember?(Application.started_applications(), app, 0)

  defp story?(folder, words),
    do: Enum.any?(Story.recent(folder), &String.contains?(&1, words))

  test "an application that ends is started again, and the story says so", context do
    %{app: app, folder: folder} = context
    kill(app)
    eventually(fn -> story?(folder, "the application #{app} runs again") end, 30_000)
    assert running?(app)
    assert story?(folder, "#{app} ended (:killed); start 1 of 4 follows")
    refute_received {Memory, _}
  end

  test "when that does not help the board restarts, and all robots are disarmed first", context do
    %{app: app, folder: folder} = context
    for _ <- 1..5, do: kill(app)
    assert_receive {Memory, :reboot}, 30_000
    assert story?(folder, "start 4 of 4 follows")
    assert story?(folder, "starts do not help; the board restarts (time 1)")
    refute_received {Memory, :revert}
  end

  test "an application that cannot start, and what depends on it, come back once it can",
       context do
    %{app: app, dependent: dependent, memory: memory, folder: folder} = context
    # A start that fails is an end, as at the start of the release.
    Application.stop(dependent)
    eventually(fn -> story?(folder, "#{dependent} was stopped by a person") end, 30_000)
    Application.stop(app)
    Application.put_env(app, :fail, true)
    assert {:error, _} = Application.start(app)
    eventually(fn -> story?(folder, ":no_such_chip") end, 30_000)
    assert_receive {Memory, :reboot}, 30_000

    # The next start of the board: the same, but for the cause.
    other = restarter(folder, memory, [app, dependent], [])
    Application.put_env(app, :fail, false)
    Restarter.handle_event(other.restarter, {:ended, app, :no_such_chip})
    eventually(fn -> running?(app) and running?(dependent) end, 30_000)
  end

  test "an application that a person has stopped stays stopped", context do
    %{app: app, dependent: dependent, folder: folder} = context
    Application.stop(dependent)
    eventually(fn -> story?(folder, "#{dependent} was stopped by a person") end, 30_000)
    kill(app)
    eventually(fn -> story?(folder, "#{app} runs again") end, 30_000)
    refute running?(dependent)
  end

  test "a board that was restarted in vain stays up, goes on trying, and quiets its watchdog",
       context do
    %{app: app, memory: memory, folder: folder} = context

    for n <- 1..3 do
      %{restarter: restarter} = restarter(folder, memory, [app], [])
      for _ <- 1..5, do: Restarter.handle_event(restarter, {:ended, app, :no_such_chip})
      assert_receive {Memory, :reboot}, 30_000
      assert story?(folder, "the board restarts (time #{n})")
    end

    %{restarter: restarter} = restarter(folder, memory, [app], [])
    for _ <- 1..5, do: Restarter.handle_event(restarter, {:ended, app, :no_such_chip})
    assert_receive {Memory, :init_complete}, 30_000
    eventually(fn -> story?(folder, "stays up for an update") end, 30_000)
    refute_received {Memory, :reboot}

    # How it began stays in the story, however long it goes on.
    for _ <- 1..200, do: Restarter.handle_event(restarter, {:ended, app, :no_such_chip})
    _ = :sys.get_state(restarter, 30_000)
    assert story?(folder, "the board restarts (time 1)")
    assert Enum.count(Story.recent(folder), &(&1 =~ "stays up for an update")) == 1

    Application.stop(app)
    Application.stop(context.dependent)
    Restarter.handle_event(restarter, {:ended, app, :no_such_chip})
    eventually(fn -> running?(app) end, 30_000)
  end

  test "restarts of the board are forgotten once all has run for a while", context do
    %{app: app, memory: memory, folder: folder} = context
    for _ <- 1..5, do: Restarter.handle_event(context.restarter, {:ended, app, :no_such_chip})
    assert_receive {Memory, :reboot}, 30_000
    file = Path.join(folder, "restarts.txt")
    assert File.exists?(file)
    restarter(folder, memory, [app], calm_ms: 1)
    eventually(fn -> not File.exists?(file) end, 30_000)
  end

  test "a board that cannot keep how often it restarts stays up", context do
    %{app: app, memory: memory, folder: folder} = context
    File.write!(Path.join(folder, "file"), "")
    %{restarter: restarter} = restarter(Path.join(folder, "file"), memory, [app], [])
    for _ <- 1..5, do: Restarter.handle_event(restarter, {:ended, app, :no_such_chip})
    _ = :sys.get_state(restarter, 30_000)
    refute_received {Memory, _}
  end

  test "firmware on trial is reverted, and the report says why", context do
    %{app: app, memory: memory, folder: folder} = context
    Memory.answer(memory, :validation_status, :unvalidated)
    :ok = Trial.begin(folder, {Memory, memory})
    for _ <- 1..5, do: kill(app)
    assert_receive {Memory, :revert}, 30_000
    report = BB.Firmware.Trial.Findings.read(folder, :reverted)
    assert report =~ "by the restarter of its applications"
    assert report =~ "#{app} ended"
    refute_received {Memory, :reboot}
  end

  test "an update that is being written is waited for", context do
    %{app: app, memory: memory, folder: folder} = context
    gate = :"gate_#{System.unique_integer([:positive])}"
    key = Path.join(folder, "key")
    File.write!(key, "key")
    own = [board: {Memory, memory}, public_key: key, folder: folder, settle_ms: 0]
    assert {:ok, _} = BB.Firmware.Gate.precheck(gate, own)
    %{restarter: restarter} = restarter(folder, memory, [app], gate: gate)
    for _ <- 1..5, do: Restarter.handle_event(restarter, {:ended, app, :no_such_chip})
    _ = :sys.get_state(restarter, 30_000)
    refute_received {Memory, :reboot}

    BB.Firmware.Gate.LockServer.leave(%{
      names: {Module.concat(gate, Lock), Module.concat(gate, Uploader)}
    })

    assert_receive {Memory, :reboot}, 30_000
  end

  test "restarter and lock belong to no application, whoever starts them", context do
    %{app: app, memory: memory, folder: folder} = context
    {:group_leader, group} = Process.info(Process.whereis(app), :group_leader)
    gate = :"gate_#{System.unique_integer([:positive])}"
    key = Path.join(folder, "key")
    File.write!(key, "key")
    own = [board: {Memory, memory}, public_key: key, folder: folder, settle_ms: 0]
    test = self()

    # It has a group of its own again, so that its end is not what ends the lock.
    uploader =
      spawn(fn ->
        before = Process.group_leader()
        Process.group_leader(self(), group)
        send(test, {Restarter.start(folder: folder), BB.Firmware.Gate.precheck(gate, own)})
        Process.group_leader(self(), before)
        receive do: (:end -> :ok)
      end)

    assert_receive {{:ok, restarter}, {:ok, _}}, 30_000
    lock = Process.whereis(Module.concat(gate, "Lock"))
    for pid <- [restarter, lock], do: assert(:application.get_application(pid) == :undefined)
    Application.stop(context.dependent)
    Application.stop(app)
    for pid <- [restarter, lock], do: assert(Process.alive?(pid))
    send(uploader, :end)
    Process.exit(restarter, :kill)
  end

  test "a board that refuses to restart goes on trying to start what has ended", context do
    %{app: app, memory: memory, folder: folder} = context
    Memory.answer(memory, :reboot, {:error, :no_board})
    for _ <- 1..5, do: kill(app)
    assert_receive {Memory, :reboot}, 30_000
    eventually(fn -> running?(app) end, 30_000)
    assert story?(folder, "the board restarts")
  end

  @tag timeout: 300_000
  test "the project's own application, killed in a VM of its own, runs again with its gate",
       %{folder: folder} do
    {again, board, story} = Killed.in_vm(:kill_supervisor, [Path.join(folder, "vm"), 4])
    assert again == [true, true, true]
    assert board == :reboot
    assert Enum.count(story, &(&1 =~ "the application ganglion runs again")) == 3
    assert List.last(story) =~ "the board restarts (time 1)"
  end

  describe "the handler" do
    setup %{folder: folder} do
      Application.put_env(:ganglion, Applications, folder: folder)

      on_exit(fn ->
        Application.delete_env(:ganglion, Applications)
        if pid = Process.whereis(Restarter), do: Process.exit(pid, :kill)
      end)
    end

    test "is one as shoehorn calls it, and never asks to halt" do
      assert {:ok, state} = Applications.init(init: [:nerves_runtime], handler: Applications)
      assert Process.whereis(Restarter)
      assert {:continue, ^state} = Applications.application_started(:some_app, state)
      assert {:continue, ^state} = Applications.application_exited(:some_app, :stopped, state)
    end

    test "starts its restarter again when that was killed" do
      {:ok, state} = Applications.init([])
      restarter = Process.whereis(Restarter)
      ref = Process.monitor(restarter)
      Process.exit(restarter, :kill)
      assert_receive {:DOWN, ^ref, :process, ^restarter, _}, 30_000
      assert {:continue, ^state} = Applications.application_exited(:some_app, :stopped, state)
      _ = :sys.get_state(Restarter)
      assert Process.whereis(Restarter) not in [nil, restarter]
    end

    test "works with options that are wrong", context do
      {:ok, restarter} =
        Restarter.start(pauses_ms: :never, nonsense: true, folder: context.folder)

      on_exit(fn -> Process.exit(restarter, :kill) end)
      assert %{} = :sys.get_state(restarter)
    end
  end
end

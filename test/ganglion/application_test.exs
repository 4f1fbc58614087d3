defmodule Ganglion.ApplicationTest do
  # The processes that are killed here serve all robots of the VM.
  use ExUnit.Case, async: false

  import BB.Test.Eventually
  import BB.Test.Robot

  alias BB.Bus.I2C
  alias BB.Safety
  alias BB.Test.{Application, Brake}

  @a [:base, :a]
  @apart [:apart]
  @lid [:lid]

  @always [
    BB.Safety.Anchor,
    BB.Bus.Sim.Registry,
    BB.Bus.Sim.GPIO.Registry,
    BB.Bus.I2C.Supervisor,
    BB.Bus.I2C.Registry,
    BB.Bus.I2C.Servers
  ]
  @safety [BB.Safety.Supervisor, BB.Safety.Wardens, BB.Safety.HostWatch]
  @firmware [BB.Firmware.Guard, BB.Firmware.Gate, BB.Firmware.Network]

  @ends [
    "is stopped": quote(do: Application.stop()),
    "loses its supervisor": quote(do: Application.kill(Process.whereis(Ganglion.Supervisor))),
    "loses its host": quote(do: Application.kill(Application.host())),
    "loses its supervisor together with safety's":
      quote do
        for name <- [BB.Safety.Supervisor, Ganglion.Supervisor],
            do: Process.exit(Process.whereis(name), :kill)
      end,
    "loses its host together with safety's supervisor":
      quote do
        for pid <- [Process.whereis(BB.Safety.Supervisor), Application.host()],
            do: Process.exit(pid, :kill)
      end
  ]

  defmodule Wires do
    @moduledoc "A bus backend that does not end with the application."

    def open(name, _opts), do: {:ok, name}
    def close(_bus), do: :ok
    def write(_bus, 0x40, <<0>>, _opts), do: :ok
    def write_read(_bus, 0x40, <<0>>, 1, _opts), do: {:ok, <<0>>}
  end

  setup do
    on_exit(&Application.restore/0)
  end

  defp declared do
    robot do
      topology do
        link :base do
          sensor :a, BB.Test.Brake
        end
      end
    end
  end

  defp kill_supervisor, do: Application.kill(Process.whereis(Ganglion.Supervisor))
  defp kill_host, do: Application.kill(Application.host())

  # A robot of another application: with a handler and a voucher outside of its tree.
  defp outside do
    robot = declared()
    test = self()

    owner =
      spawn(fn ->
        Process.flag(:trap_exit, true)
        {:ok, root} = robot.start_link()
        send(test, {:root, root})
        Process.sleep(:infinity)
      end)

    assert_receive {:root, root}, 30_000
    on_exit(fn -> end_with(owner, root) end)
    %{robot: armed(robot), root: root, voucher: voucher(robot)}
  end

  defp end_with(owner, root) do
    if Process.alive?(root), do: Supervisor.stop(root)
    Process.exit(owner, :kill)
  end

  defp armed(robot) do
    await_up(robot)
    Brake.register_apart(robot, @apart)
    :ok = Safety.arm(robot)
    robot
  end

  defp await_up(robot),
    do: assert(eventually(fn -> Enum.all?(health(robot), &(&1.state == :up)) end, 30_000))

  defp health(robot) do
    BB.Sensor.health(robot)
  rescue
    ArgumentError -> [%{state: :down}]
  end

  defp voucher(robot) do
    test = self()

    voucher =
      spawn(fn ->
        :ok = Safety.vouch(robot, @lid)
        send(test, {:vouched, self()})
        Process.sleep(:infinity)
      end)

    assert_receive {:vouched, ^voucher}, 30_000
    voucher
  end

  defp runs(robot), do: {Brake.runs(robot, @a), Brake.runs(robot, @apart)}
  defp warden(robot), do: Process.whereis(Module.concat(robot, "Safety"))

  # It is armed, and the death of its voucher disarms it.
  defp assert_watched(%{robot: robot, voucher: voucher}) do
    assert Safety.armed?(robot)
    assert runs(robot) == {0, 0}
    Application.kill(voucher)
    assert_disarmed_once(robot)
  end

  defp assert_disarmed_once(robot) do
    assert eventually(fn -> Safety.state(robot) == :disarmed end, 30_000)
    assert runs(robot) == {1, 1}
  end

  # It can be armed and disarmed as before.
  defp assert_usable(robot) do
    before = runs(robot)
    assert Safety.arm(robot) == :ok
    assert Safety.disarm(robot) == :ok
    assert runs(robot) == {elem(before, 0) + 1, elem(before, 1) + 1}
  end

  describe "a robot of another application that is armed" do
    for name <- @always ++ @safety do
      test "is armed and monitored however often #{inspect(name)} is killed" do
        outside = outside()
        application = Process.whereis(Ganglion.Supervisor)
        Application.kill(unquote(name), 12)
        assert eventually(fn -> Process.whereis(unquote(name)) end, 30_000)
        assert eventually(fn -> warden(outside.robot) end, 30_000)
        assert_watched(outside)
        assert Process.whereis(Ganglion.Supervisor) == application
      end
    end

    test "is armed and monitored whichever process of the application is killed" do
      outside = outside()
      application = Process.whereis(Ganglion.Supervisor)

      for {path, _pid} <- Application.tree(Ganglion.Supervisor), path != [], _ <- 1..3 do
        find = fn -> List.keyfind(Application.tree(Ganglion.Supervisor), path, 0) end
        {^path, pid} = eventually(find, 30_000)
        Application.kill(pid)
      end

      assert eventually(fn -> Enum.all?(@always ++ @safety, &Process.whereis/1) end, 30_000)
      assert_watched(outside)
      assert Process.whereis(Ganglion.Supervisor) == application
    end

    # The handler opens the bus, or another process has opened it before.
    for opened <- [:anew, :before] do
      test "is made safe over its bus (opened #{opened}) however the application ends" do
        for {how, ending} <- [
              kill: &kill_supervisor/0,
              host: &kill_host/0,
              stop: &Application.stop/0
            ] do
          outside = outside()
          bus = "bus of #{inspect(outside.robot)}"
          {:ok, before} = I2C.open(bus, backend: Wires)

          open = fn ->
            if unquote(opened) == :anew, do: I2C.open(bus, backend: Wires), else: {:ok, before}
          end

          Brake.script(outside.robot, @a,
            disarm: fn _opts ->
              with {:ok, wires} <- open.(),
                   # The time that the application's processes take to end.
                   :ok <- Process.sleep(:rand.uniform(20) - 1),
                   :ok <- I2C.write(wires, 0x40, <<0>>),
                   {:ok, <<0>>} <- I2C.write_read(wires, 0x40, <<0>>, 1),
                   do: I2C.close(wires)
            end
          )

          ending.()
          Application.await_end()
          assert eventually(fn -> Safety.state(outside.robot) != :armed end, 30_000)
          assert eventually(fn -> Safety.state(outside.robot) != :disarming end, 30_000)
          assert {how, Safety.state(outside.robot)} == {how, :disarmed}
          assert runs(outside.robot) == {1, 1}
          Application.start()
        end
      end
    end

    test "is monitored when all of safety is killed at once" do
      outside = outside()
      for name <- @safety ++ [BB.Safety.Anchor], do: Process.exit(Process.whereis(name), :kill)
      assert eventually(fn -> Enum.all?(@safety, &Process.whereis/1) end, 30_000)
      assert_watched(outside)
    end

    for {how, ending} <- @ends do
      test "is disarmed when the application #{how}, and can be armed after its restart" do
        %{robot: robot, root: root, voucher: voucher} = outside()
        unquote(ending)
        Application.await_end()
        assert_disarmed_once(robot)
        assert Safety.disarm(robot) == {:error, :already_disarmed}
        assert Safety.arm(robot) == {:error, :not_running}
        assert Process.whereis(robot) == root

        Application.start()
        assert_usable(robot)
        assert Safety.arm(robot) == :ok
        Application.kill(voucher)
        assert eventually(fn -> Safety.state(robot) == :disarmed end, 30_000)
      end
    end

    test "is disarmed by each end of the application, however often it restarts" do
      %{robot: robot} = outside()

      for n <- 1..5 do
        Application.kill(Process.whereis(Ganglion.Supervisor))
        Application.await_end()
        assert eventually(fn -> Safety.state(robot) == :disarmed end, 30_000)
        assert {n, runs(robot)} == {n, {n, n}}
        Application.start()
        assert Safety.arm(robot) == :ok
      end
    end

    test "with a slow handler delays the application, not other robots" do
      slow = outside()
      quick = outside()
      test = self()

      Brake.script(slow.robot, @a,
        disarm: fn _opts ->
          send(test, {:held, self()})
          receive do: (:go_on -> :ok)
        end
      )

      Application.kill(Process.whereis(Ganglion.Supervisor))
      assert_receive {:held, held}, 30_000
      assert_disarmed_once(quick.robot)
      refute Safety.armed?(slow.robot)
      assert Application.running?()
      send(held, :go_on)
      Application.await_end()
      assert_disarmed_once(slow.robot)
    end
  end

  test "a robot that is armed when another application takes safety over is disarmed" do
    %{robot: robot} = outside()
    host = spawn(fn -> Safety.HostWatch.enter() && Process.sleep(:infinity) end)
    assert_disarmed_once(robot)
    assert eventually(fn -> Safety.arm(robot) == :ok end, 30_000)
    Application.kill(host)
    assert eventually(fn -> Safety.state(robot) == :disarmed end, 30_000)
    assert Safety.arm(robot) == {:error, :not_running}
    :ok = Application.stop()
  end

  describe "a robot inside the application" do
    setup do
      robot = declared()
      Application.start_with(robot)
      %{robot: armed(robot)}
    end

    for {how, ending} <- Keyword.take(@ends, [:"is stopped", :"loses its supervisor"]) do
      test "is disarmed when the application #{how}", %{robot: robot} do
        unquote(ending)
        Application.await_end()
        assert_disarmed_once(robot)
        assert Safety.disarm(robot) == {:error, :not_registered}

        Application.start()
        await_up(robot)
        assert_usable(robot)
      end
    end

    test "is disarmed when the host is killed", %{robot: robot} do
      Application.kill(Application.host())
      Application.await_end()
      assert eventually(fn -> not Safety.Records.known?(robot) end, 30_000)
      assert runs(robot) == {1, 1}
    end

    for name <- @firmware ++ [BB.Firmware.Supervisor] do
      test "is the same process however often #{inspect(name)} is killed", %{robot: robot} do
        others = others([unquote(name), BB.Firmware.Supervisor | below(unquote(name))], robot)
        Application.kill(unquote(name), 8)
        assert eventually(fn -> Process.whereis(unquote(name)) end, 30_000)

        assert others([unquote(name), BB.Firmware.Supervisor | below(unquote(name))], robot) ==
                 others

        assert Safety.armed?(robot)
      end
    end

    test "uses up no other restarts, however often it is killed", %{robot: robot} do
      others = others([robot], robot)
      Application.kill(robot, 8)
      await_up(robot)
      assert others([robot], robot) == others
      assert eventually(fn -> Safety.state(robot) == :disarmed end, 30_000)
      assert runs(robot) == {1, 1}
    end

    test "that cannot be started for a while fails no other process", %{robot: robot} do
      others = others([robot], robot)
      {[^robot], bulkhead} = List.keyfind(Application.tree(Ganglion.Supervisor), [robot], 0)
      holder = eventually(fn -> take_name(robot) end, 30_000)
      # It waits that long after some eight attempts.
      assert eventually(fn -> waited_ms(bulkhead) >= 128 end, 30_000)
      assert others([robot], robot) == others
      Agent.stop(holder)
      await_up(robot)
      assert others([robot], robot) == others
    end
  end

  defp take_name(robot) do
    if pid = Process.whereis(robot), do: Application.kill(pid)

    case Agent.start_link(fn -> nil end, name: robot) do
      {:ok, holder} -> holder
      {:error, {:already_started, _pid}} -> nil
    end
  end

  defp waited_ms(bulkhead) do
    {:dictionary, dictionary} = Process.info(bulkhead, :dictionary)
    {_started_ms, waited_ms} = dictionary[BB.Process.Bulkhead]
    waited_ms
  end

  defp below(BB.Firmware.Supervisor), do: @firmware
  defp below(_name), do: []

  defp others(killed, robot) do
    names = [robot, Ganglion.Supervisor, BB.Safety.Supervisor | @always ++ @firmware]
    for name <- names, name not in killed, do: {name, Process.whereis(name)}
  end
end

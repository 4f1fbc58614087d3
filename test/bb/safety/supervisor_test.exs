defmodule BB.Safety.SupervisorTest do
  # What is killed here serves all robots of the VM.
  use ExUnit.Case, async: false

  import BB.Test.Eventually

  alias BB.Safety
  alias BB.Test.Brake

  @a [:a]

  setup do
    robot = Module.concat(__MODULE__, "Bare#{System.unique_integer([:positive])}")
    :ok = Brake.register(robot, @a)
    :ok = Safety.arm(robot)
    %{robot: robot}
  end

  for process <- [BB.Safety.Wardens, BB.Safety.Supervisor] do
    test "when #{inspect(process)} is killed, what is armed stays armed and is still watched", %{
      robot: robot
    } do
      {owner, watched} = armed_by_another()
      kill(unquote(process))
      assert Safety.armed?(robot)
      assert Safety.arm(robot) == {:error, :already_armed}
      assert eventually(fn -> Process.whereis(unquote(process)) end)

      Process.exit(owner, :kill)
      assert eventually(fn -> Brake.runs(watched, @a) == 1 end)
      assert eventually(fn -> not Safety.Records.known?(watched) end)

      assert Safety.disarm(robot) == :ok
      assert Brake.runs(robot, @a) == 1
    end

    test "when #{inspect(process)} is killed, a disarming under way goes on", %{robot: robot} do
      test = self()

      Brake.script(robot, @a,
        disarm: fn _opts ->
          send(test, {:held, self()})
          receive do: (:go_on -> :ok)
        end
      )

      disarming = Task.async(fn -> Safety.disarm(robot, timeout: 60_000) end)
      assert_receive {:held, held}
      kill(unquote(process))
      send(held, :go_on)
      assert Task.await(disarming, :infinity) == :ok
      assert Brake.runs(robot, @a) == 1
    end
  end

  # A supervisor lets go of its children before it tells them to end.
  test "a warden that was left behind by a supervisor killed in the midst of its end has a successor",
       %{robot: robot} do
    name = Module.concat(robot, "Safety")
    assert eventually(fn -> Process.whereis(BB.Safety.Wardens) && Process.whereis(name) end)
    former = Process.whereis(name)
    :ok = :sys.suspend(BB.Safety.Wardens)
    Process.exit(former, :kill)
    assert eventually(fn -> Process.whereis(name) == nil end)
    {:ok, orphan} = GenServer.start(BB.Safety.Warden, {robot, :nobody, nil}, name: name)
    on_exit(fn -> Process.exit(orphan, :kill) end)
    :ok = :sys.resume(BB.Safety.Wardens)

    assert eventually(fn -> Process.whereis(name) not in [nil, orphan] end)
    assert Safety.armed?(robot)
    assert Safety.disarm(robot) == :ok
    assert Brake.runs(robot, @a) == 1
  end

  test "when the application stops, what is armed is disarmed first", %{robot: robot} do
    Ganglion.Application.prep_stop(nil)
    assert Brake.runs(robot, @a) == 1
    assert Safety.state(robot) == :disarmed
  end

  # A robot whose only process is the one that is returned.
  defp armed_by_another do
    robot = Module.concat(__MODULE__, "Bare#{System.unique_integer([:positive])}")
    owner = Brake.register_apart(robot, @a)
    :ok = Safety.arm(robot)
    {owner, robot}
  end

  defp kill(name) do
    pid = Process.whereis(name)
    ref = Process.monitor(pid)
    Process.exit(pid, :kill)
    assert_receive {:DOWN, ^ref, _, _, _}
  end
end

defmodule BB.Test.Killed do
  @moduledoc """
  A VM of its own in which the application is killed, under shoehorn (`BB.Test.Shoehorn`).

  The robots of all other tests would end with it.
  """

  import BB.Test.Eventually

  alias BB.Firmware.Applications
  alias BB.Firmware.Applications.Restarter
  alias BB.Firmware.Board.Memory
  alias BB.Test.Shoehorn

  @wait_ms 60_000

  @doc "Starts the VM, and calls `fun` of this module with `args` in it."
  def in_vm(fun, args) do
    paths = Enum.flat_map(:code.get_path(), &[~c"-pa", &1])
    {:ok, vm, _node} = :peer.start_link(%{connection: :standard_io, args: paths})
    result = :peer.call(vm, __MODULE__, fun, args, 4 * @wait_ms)
    :peer.stop(vm)
    result
  end

  @doc """
  Kills the application's supervisor repeatedly.

  Returns the observations: for each kill but the last whether the application and its gate ran
  again, then the requests to the board.
  """
  def kill_supervisor(folder, kills) do
    be_quiet()
    {:ok, memory} = Memory.start_link(status: :validated, tell: self())
    board = {Memory, memory}
    robot = robot()

    for {key, value} <- [{:board, board}, {:robot, robot}, {BB.Firmware.Guard, [folder: folder]}],
        do: Application.put_env(:ganglion, key, value)

    {:ok, restarter} =
      Restarter.start(
        pauses_ms: List.duplicate(0, kills - 1),
        expected: [:ganglion],
        board: board,
        folder: folder
      )

    Shoehorn.start(Applications, restarter, [:ganglion])
    {:ok, _} = Application.ensure_all_started(:ganglion)
    again = for _ <- 2..kills, do: kill_and_wait(robot)
    kill()
    board = receive do: ({Memory, :reboot} -> :reboot), after: (@wait_ms -> :nothing)
    {again, board, BB.Firmware.Story.recent(folder)}
  end

  defp kill_and_wait(robot) do
    kill()
    eventually(fn -> running?(robot) end, @wait_ms)
  end

  defp kill do
    pid = eventually(fn -> Process.whereis(Ganglion.Supervisor) end, @wait_ms)
    ref = Process.monitor(pid)
    Process.exit(pid, :kill)
    receive do: ({:DOWN, ^ref, :process, ^pid, _} -> :ok)
  end

  defp running?(robot) do
    Enum.all?([Ganglion.Supervisor, BB.Firmware.Gate, robot], &Process.whereis/1) and
      List.keymember?(Application.started_applications(), :ganglion, 0)
  end

  # A robot without topics, which the whole machine would share.
  defp robot do
    BB.Test.Robot.create(
      quote do
        topology do
          link :base_link do
            sensor :probe, BB.Test.Probe
          end
        end
      end
    )
  end

  # The output is this VM's connection. Shoehorn gets each event before any handler of the logger.
  defp be_quiet do
    _ = Application.load(:logger)
    Application.put_env(:logger, :backends, [])
    {:ok, _} = Application.ensure_all_started(:logger)
    Logger.configure(level: :debug)
    for id <- :logger.get_handler_ids(), do: :logger.remove_handler(id)
  end
end

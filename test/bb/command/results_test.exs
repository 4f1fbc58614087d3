defmodule BB.Command.ResultsTest do
  # It kills the process that keeps the results of all robots.
  use ExUnit.Case, async: false

  import BB.Test.Eventually

  alias BB.Command

  defmodule Sum do
    use BB.Command

    @impl BB.Command
    def handle_command(%{number: number}, _context, state),
      do: {:noreply, %{state | result: number}}

    @impl BB.Command
    def handle_info({:add, number}, state),
      do: {:stop, :normal, %{state | result: state.result + number}}

    @impl BB.Command
    def result(%{result: result}), do: {:ok, result}
  end

  defmodule Robot do
    use BB

    commands do
      command :sum, handler: Sum, allowed_states: :*
    end
  end

  setup do
    start_supervised!(Robot)
    {:ok, pid} = Robot.sum(number: 1)
    keeper = Process.whereis(Command.Results)
    kill = fn -> Process.exit(keeper, :kill) end
    restarted = fn -> Process.whereis(Command.Results) not in [keeper, nil] end
    %{pid: pid, kill: kill, restarted: restarted}
  end

  test "the process that keeps results may die while a command runs", %{pid: pid} = context do
    waiting = Task.async(fn -> Command.await(pid, 60_000) end)
    eventually(fn -> length(:sys.get_state(pid).waiting) == 1 end)
    context.kill.()
    eventually(context.restarted)
    send(pid, {:add, 1})
    assert Task.await(waiting, 60_000) == {:ok, 2}
  end

  test "a result is kept by its successor", %{pid: pid} = context do
    context.kill.()
    eventually(context.restarted)
    send(pid, {:add, 1})
    eventually(fn -> not Process.alive?(pid) end)
    assert Command.await(pid) == {:ok, 2}
    assert Command.await(pid) == {:error, {:command_failed, :noproc}}
  end

  test "a command ends without it", %{pid: pid} = context do
    waiting = Task.async(fn -> Command.await(pid, 60_000) end)
    eventually(fn -> length(:sys.get_state(pid).waiting) == 1 end)
    context.kill.()
    send(pid, {:add, 1})
    assert Task.await(waiting, 60_000) == {:ok, 2}
    eventually(context.restarted)
  end

  test "a result is removed after its time", %{pid: pid} do
    send(pid, {:add, 1})
    eventually(fn -> not Process.alive?(pid) end)
    eventually(fn -> pid not in :sys.get_state(Command.Results) end)
    assert [_row] = :ets.lookup(Command.Results, pid)
    send(Command.Results, {:remove, pid})
    assert %MapSet{} = :sys.get_state(Command.Results)
    assert Command.await(pid) == {:error, {:command_failed, :noproc}}
  end

  test "other requests do not harm it" do
    assert GenServer.call(Command.Results, :anything) == {:error, :not_implemented}
  end
end

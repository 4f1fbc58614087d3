defmodule BB.Safety.RoundTest do
  use ExUnit.Case, async: true

  alias BB.Safety.{Records, Round}
  alias BB.Test.Brake

  @path [:brake]

  defp round do
    robot = Module.concat(__MODULE__, "Robot#{System.unique_integer([:positive])}")
    Records.register(robot, @path, self(), Brake, bb: %{robot: robot, path: @path})
    on_exit(fn -> Records.clear_runs(robot, nil) end)
    on_exit(fn -> for row <- Records.handlers(robot), do: Records.release(row) end)
    {robot, Round.new(robot, 60_000, :requested)}
  end

  test "a handler is called by one of those who take its turn" do
    {robot, round} = round()
    [{key, :nobody, nil, {_, _owner, module, opts, _id}}] = Records.runs(robot, round.id)

    takers =
      for _ <- 1..100,
          do: Task.async(fn -> receive do: (:go -> Round.run(key, module, opts)) end)

    for taker <- takers, do: send(taker.pid, :go)
    taken = Task.await_many(takers, 30_000)
    assert Enum.count(taken, & &1) == 1
    assert Brake.runs(robot, @path) == 1
    assert Round.close(round, robot) == []
  end

  test "whoever continues a round waits for what somebody calls already" do
    {robot, round} = round()
    test = self()

    Brake.script(robot, @path,
      disarm: fn _opts ->
        send(test, {:held, self()})
        receive do: (:go_on -> :ok)
      end
    )

    _first = Round.continue(round, robot)
    assert_receive {:held, held}, 30_000
    runs = Round.continue(round, robot)
    assert [{ref, key}] = Map.to_list(runs)
    send(held, :go_on)
    assert_receive {:DOWN, ^ref, :process, ^held, reason}, 30_000
    assert Round.handle_down(key, held, reason) == :done
    assert Round.continue(round, robot) == %{}
    assert Round.close(round, robot) == []
    assert Brake.runs(robot, @path) == 1
  end
end

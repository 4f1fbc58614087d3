defmodule BB.PubSub.BusTest do
  use ExUnit.Case, async: true

  alias BB.PubSub.Bus
  alias BB.Test.Actor

  # The tables belong to the process that opens the bus.
  defp open(robot, owner),
    do: Actor.run(owner, fn -> Bus.open(robot, BB.PubSub.registry_name(robot)) end)

  test "the bus of a predecessor that closes late leaves its successor's in place" do
    robot = Module.concat(__MODULE__, Robot)
    first = Actor.start()
    former = open(robot, first)
    Actor.stop(first)
    bus = open(robot, Actor.start())
    assert bus.subscriptions != former.subscriptions
    :ok = Bus.close(former)
    assert Bus.fetch(robot) == {:ok, bus}
    :ok = Bus.close(bus)
    assert Bus.fetch(robot) == :error
  end
end

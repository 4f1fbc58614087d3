defmodule BB.Parameter.Store.Log.KillTest do
  @moduledoc """
  Kills a VM at random instants, a hundred times (`KILLS=1000 mix test …` for more), while fifty
  processes of it set parameters.
  """

  use ExUnit.Case, async: true

  import BB.Test.Eventually

  alias BB.Parameter.Store.Log
  alias BB.Test.KeepingNode

  @moduletag :tmp_dir
  @moduletag timeout: 1_800_000

  @kills String.to_integer(System.get_env("KILLS", "100"))
  @longest_life_ms 120

  test "nothing that set has acknowledged is lost by a kill, and each set_many is whole",
       context do
    kill_often(Log, @kills, context.tmp_dir)
  end

  defp kill_often(store, kills, folder) do
    file = Path.join(folder, "params")
    acknowledged = Path.join(folder, "acknowledged")
    start = fn -> KeepingNode.start(store, file, acknowledged) end

    # One VM starts while the other is at work.
    last =
      Enum.reduce(1..kills, start.(), fn kill, node ->
        assert_receive {^node, {:data, {:eol, "ready"}}}, 60_000
        next = start.()
        before = KeepingNode.acknowledged(acknowledged)
        Port.command(node, "go\n")
        # Every other one has work done; the others may be killed while they open the file.
        if rem(kill, 2) == 0, do: await_more(acknowledged, before)
        Process.sleep(:rand.uniform(@longest_life_ms))
        KeepingNode.kill(node)
        assert_kept(store, file, KeepingNode.acknowledged(acknowledged), kill)
        next
      end)

    KeepingNode.kill(last)
    refute File.exists?(file <> ".corrupt")
  end

  defp await_more(acknowledged, before),
    do: eventually(fn -> KeepingNode.acknowledged(acknowledged) != before end, 60_000)

  defp assert_kept(store, file, acknowledged, kill) do
    {:ok, state} = store.init(KeepingNode, path: file)
    {:ok, pairs} = store.load(state)
    kept = Map.new(pairs)
    assert store.damage(state) == nil
    :ok = store.close(state)

    for writer <- KeepingNode.writers() do
      [left, right] = for path <- KeepingNode.pair(writer), do: Map.get(kept, path, 0)
      assert left == right, "kill #{kill}: #{left} and #{right} of one set_many"
      at_least = Map.get(acknowledged, writer, 0)
      assert left >= at_least, "kill #{kill}: #{at_least} was acknowledged, #{left} is there"
    end
  end
end

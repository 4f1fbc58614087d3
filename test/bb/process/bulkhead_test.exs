defmodule BB.Process.BulkheadTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually

  alias BB.Process.Bulkhead

  doctest Bulkhead

  # More restarts than any supervisor without a bulkhead allows.
  @often 8

  defp start(children) do
    Supervisor.start_link(Enum.map(children, &Bulkhead.child_spec/1), strategy: :one_for_one)
  end

  defp agent(name, start \\ fn -> nil end),
    do: %{id: name, start: {Agent, :start_link, [start, [name: name]]}}

  test "a child that is killed again and again is started again, and its sibling stays" do
    {:ok, above} = start([agent(__MODULE__.Killed), agent(__MODULE__.Sibling)])
    sibling = Process.whereis(__MODULE__.Sibling)

    for _ <- 1..@often do
      pid = eventually(fn -> Process.whereis(__MODULE__.Killed) end, 30_000)
      Process.exit(pid, :kill)
      assert eventually(fn -> Process.whereis(__MODULE__.Killed) not in [nil, pid] end, 30_000)
    end

    assert Process.whereis(__MODULE__.Sibling) == sibling
    assert Process.alive?(above)
  end

  test "a child that cannot be started again is tried until it can" do
    broken = :atomics.new(1, [])
    tries = :counters.new(1, [])

    start = fn ->
      :counters.add(tries, 1, 1)
      if :atomics.get(broken, 1) == 1, do: raise("broken"), else: nil
    end

    {:ok, above} = start([agent(__MODULE__.Broken, start), agent(__MODULE__.Whole)])
    whole = Process.whereis(__MODULE__.Whole)
    :atomics.put(broken, 1, 1)
    Process.exit(Process.whereis(__MODULE__.Broken), :kill)
    assert eventually(fn -> :counters.get(tries, 1) > @often end, 30_000)
    :atomics.put(broken, 1, 0)
    assert eventually(fn -> Process.whereis(__MODULE__.Broken) end, 30_000)
    assert Process.whereis(__MODULE__.Whole) == whole
    assert Process.alive?(above)
  end

  test "a child that cannot be started the first time fails the start, with its own reason" do
    Process.flag(:trap_exit, true)
    child = %{id: :absent, start: {Function, :identity, [{:error, :absent}]}}
    assert {:error, reason} = start([child])
    assert BB.Supervisor.format_error(reason) == Exception.format_exit(:absent)
  end

  test "a bulkhead that is stopped stops its child" do
    {:ok, above} = start([agent(__MODULE__.Stopped)])
    ref = Process.monitor(__MODULE__.Stopped)
    Supervisor.stop(above)
    assert_received {:DOWN, ^ref, :process, _pid, :shutdown}
  end
end

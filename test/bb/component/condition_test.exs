defmodule BB.Component.ConditionTest do
  use ExUnit.Case, async: true

  alias BB.Component.{Backoff, Condition, Reason}

  doctest Reason

  @second 1_000_000_000

  defp new do
    %{Condition.new(0) | backoff: Backoff.new(random: fn -> 1.0 end)}
  end

  test "a component starts, comes up, goes down and comes up" do
    assert %{state: :starting, since_ns: 0} = condition = new()
    assert %{state: :up, since_ns: 1} = condition = Condition.up(condition, 1)

    condition = Condition.down(condition, :crash, :oops, 2)
    assert %{state: :backoff, reason: :oops, retry_in_ms: 100, since_ns: 2} = condition

    assert %{state: :backoff, restarts: 1, retry_in_ms: nil, reason: :oops} =
             condition = Condition.restarted(condition, 2)

    assert %{state: :up, reason: nil, restarts: 1, since_ns: 3} = Condition.up(condition, 3)
  end

  test "what is wrong with one that goes on is its last error, and changes nothing else" do
    up = Condition.up(new(), 1)
    assert %{last_error: :file_renewed} = troubled = Condition.troubled(up, :file_renewed)
    assert %{troubled | last_error: nil} == up
    refute Condition.news?(up, troubled) or Condition.alarming?(troubled)
    assert Condition.explain(up, troubled, &"words of #{&1}").error == "words of file_renewed"
  end

  test "going down again for another reason keeps the time at which it went down" do
    condition = new() |> Condition.down(:absent, :a, 1) |> Condition.down(:absent, :b, 2)
    assert %{since_ns: 1, reason: :b, retry_in_ms: 200} = condition
  end

  test "what is slow to start and crashes is tried again less often" do
    up = fn condition, init_ns -> Condition.up(condition, condition.started_ns + init_ns) end

    crashed = fn init_ns ->
      Enum.reduce(1..9, new(), fn _, condition ->
        condition
        |> Condition.restarted(condition.since_ns)
        |> up.(init_ns)
        |> then(&Condition.down(&1, :crash, :a, &1.since_ns))
      end)
    end

    assert crashed.(0).retry_in_ms == 750
    assert crashed.(@second).retry_in_ms == 4_000
    assert crashed.(60 * @second).retry_in_ms == 5_000
  end

  test "the time in which init ran is no stable run" do
    condition = new() |> Condition.down(:crash, :a, 0) |> Condition.down(:crash, :b, 60 * @second)
    assert condition.retry_in_ms == 200
  end

  test "a stable run forgets the failures, staleness in it or not" do
    down = new() |> Condition.down(:crash, :a, 0)
    up = Condition.up(down, @second)
    assert Condition.down(up, :crash, :b, 2 * @second).retry_in_ms == 100
    stale = Condition.silent(up, {:silent, 1}, 2 * @second)
    assert Condition.down(stale, :crash, :b, 2 * @second + 1).retry_in_ms == 100
    assert Condition.down(up, :crash, :b, 2 * @second - 1).retry_in_ms == 200
  end

  test "what is heard ends a silence, but not that of an init" do
    stale = new() |> Condition.up(1) |> Condition.silent({:silent, 1}, 2)
    assert %{state: :up, reason: nil, since_ns: 3} = Condition.heard(stale, 3)
    hanging = Condition.silent(new(), {:init_timeout, 1}, 2)
    assert Condition.heard(hanging, 3) == hanging
    up = Condition.up(new(), 1)
    assert Condition.heard(up, 2) == up
  end

  test "news is another state or another reason" do
    down = Condition.down(new(), :absent, :a, 1)
    refute Condition.news?(down, Condition.down(down, :absent, :a, 2))
    assert Condition.news?(down, Condition.down(down, :absent, :b, 2))
    assert Condition.news?(down, Condition.up(down, 2))
  end

  test "only backoff and silence call for an alarm" do
    up = Condition.up(new(), 1)

    assert [false, false, false, true, true] ==
             Enum.map(
               [
                 new(),
                 up,
                 Condition.ignored(new(), 1),
                 Condition.silent(up, {:silent, 1}, 2),
                 Condition.down(up, :crash, :x, 2)
               ],
               &Condition.alarming?/1
             )
  end
end

defmodule BB.Component.StatusTest do
  use ExUnit.Case, async: true

  alias BB.Component.{Backoff, Reason, Status}

  doctest Reason
  doctest Status

  @second 1_000_000_000

  defp new do
    %{Status.new(0) | backoff: Backoff.new(random: fn -> 1.0 end)}
  end

  test "a component starts, comes up, goes down and comes up" do
    assert %{state: :starting, since_ns: 0} = status = new()
    assert %{state: :up, since_ns: 1} = status = Status.up(status, 1)

    status = Status.down(status, :crash, :oops, 2)
    assert %{state: :backoff, reason: :oops, retry_in_ms: 100, since_ns: 2} = status

    assert %{state: :backoff, restarts: 1, retry_in_ms: nil, reason: :oops} =
             status = Status.restarted(status, 2)

    assert %{state: :up, reason: nil, restarts: 1, since_ns: 3} = Status.up(status, 3)
  end

  test "trouble of a component that runs on is its last error, and changes nothing else" do
    up = Status.up(new(), 1)
    assert %{last_error: :file_renewed} = troubled = Status.put_last_error(up, :file_renewed)
    assert %{troubled | last_error: nil} == up
    refute Status.changed?(up, troubled) or Status.alarm?(troubled)
    assert Status.put_error_text(troubled, up, &"words of #{&1}").error == "words of file_renewed"
  end

  test "another reason while it is down does not change the time at which it went down" do
    status = new() |> Status.down(:absent, :a, 1) |> Status.down(:absent, :b, 2)
    assert %{since_ns: 1, reason: :b, retry_in_ms: 200} = status
  end

  test "a component that starts slowly and crashes is retried less often" do
    up = fn status, init_ns -> Status.up(status, status.started_ns + init_ns) end

    crashed = fn init_ns ->
      Enum.reduce(1..9, new(), fn _, status ->
        status
        |> Status.restarted(status.since_ns)
        |> up.(init_ns)
        |> then(&Status.down(&1, :crash, :a, &1.since_ns))
      end)
    end

    assert crashed.(0).retry_in_ms == 750
    assert crashed.(@second).retry_in_ms == 4_000
    assert crashed.(60 * @second).retry_in_ms == 5_000
  end

  test "the time of init is no stable run" do
    status = new() |> Status.down(:crash, :a, 0) |> Status.down(:crash, :b, 60 * @second)
    assert status.retry_in_ms == 200
  end

  test "a stable run resets the failures, with staleness in it or not" do
    down = new() |> Status.down(:crash, :a, 0)
    up = Status.up(down, @second)
    assert Status.down(up, :crash, :b, 2 * @second).retry_in_ms == 100
    stale = Status.stale(up, {:silent, 1}, 2 * @second)
    assert Status.down(stale, :crash, :b, 2 * @second + 1).retry_in_ms == 100
    assert Status.down(up, :crash, :b, 2 * @second - 1).retry_in_ms == 200
  end

  test "activity ends a silence, but not that of an init" do
    stale = new() |> Status.up(1) |> Status.stale({:silent, 1}, 2)
    assert %{state: :up, reason: nil, since_ns: 3} = Status.active(stale, 3)
    hanging = Status.stale(new(), {:init_timeout, 1}, 2)
    assert Status.active(hanging, 3) == hanging
    up = Status.up(new(), 1)
    assert Status.active(up, 2) == up
  end

  test "a change is another state or another reason" do
    down = Status.down(new(), :absent, :a, 1)
    refute Status.changed?(down, Status.down(down, :absent, :a, 2))
    assert Status.changed?(down, Status.down(down, :absent, :b, 2))
    assert Status.changed?(down, Status.up(down, 2))
  end

  test "only backoff and silence call for an alarm" do
    up = Status.up(new(), 1)

    assert [false, false, false, true, true] ==
             Enum.map(
               [
                 new(),
                 up,
                 Status.ignored(new(), 1),
                 Status.stale(up, {:silent, 1}, 2),
                 Status.down(up, :crash, :x, 2)
               ],
               &Status.alarm?/1
             )
  end
end

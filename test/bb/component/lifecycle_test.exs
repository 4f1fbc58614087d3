defmodule BB.Component.LifecycleTest do
  use ExUnit.Case, async: true

  alias BB.Component.{Lifecycle, Server, Status}

  doctest Lifecycle

  @ms 1_000_000

  @events [
    :started,
    {:start_failed, :no_registry},
    :orphan_found,
    :orphan_exited,
    :init_timeout,
    :up,
    :stopping,
    {:activity_checked, 0, 0},
    {:exited, {:absent, :no_answer}},
    {:exited, {:crash, :oops}},
    {:exited, :ignored},
    :retry,
    {:trouble, :file_renewed}
  ]

  # What the table of the moduledoc has: the next phase and the actions, by name.
  @transitions %{
    {:starting, :started} => {:starting, [:watch_init]},
    {:starting, {:start_failed, :no_registry}} => {:backoff, [:retry_after]},
    {:starting, :orphan_found} => {:blocked, []},
    {:starting, :init_timeout} => {:starting, []},
    {:starting, :up} => {:running, [:watch_activity]},
    {:starting, {:exited, {:absent, :no_answer}}} => {:backoff, [:retry_after]},
    {:starting, {:exited, {:crash, :oops}}} => {:backoff, [:retry_after]},
    {:starting, {:exited, :ignored}} => {:ignored, []},
    {:blocked, :orphan_exited} => {:starting, [:start]},
    {:running, :stopping} => {:stopping, []},
    {:running, {:exited, {:absent, :no_answer}}} => {:backoff, [:retry_after]},
    {:running, {:exited, {:crash, :oops}}} => {:backoff, [:retry_after]},
    {:running, {:exited, :ignored}} => {:ignored, []},
    {:stopping, {:exited, {:absent, :no_answer}}} => {:backoff, [:retry_after]},
    {:stopping, {:exited, {:crash, :oops}}} => {:backoff, [:retry_after]},
    {:stopping, {:exited, :ignored}} => {:ignored, []},
    {:backoff, :retry} => {:starting, [:start]}
  }

  defp new(phase), do: %{Lifecycle.new(0, 100 * @ms) | phase: phase}

  test "each event in each phase leads where the table says, and nowhere else" do
    for phase <- [:starting, :blocked, :running, :stopping, :backoff, :ignored],
        event <- @events do
      {next, actions} = Lifecycle.transition(new(phase), event, 1)
      names = for action <- actions, do: if(is_tuple(action), do: elem(action, 0), else: action)
      expected = Map.get(@transitions, {phase, event}, {phase, []})
      assert {next.phase, names} == expected, "#{phase}, #{inspect(event)}"
    end
  end

  test "an init that does not return makes the component stale" do
    {%{status: status}, []} = Lifecycle.transition(new(:starting), :init_timeout, 1)
    assert %{state: :stale, reason: {:init_timeout, 5_000}} = status
  end

  test "trouble is the last error, in any phase" do
    {%{status: status}, []} = Lifecycle.transition(new(:running), {:trouble, :file_renewed}, 1)
    assert status.last_error == :file_renewed
  end

  describe "a check of its activity" do
    setup do
      {running, _actions} = Lifecycle.transition(new(:starting), :up, 0)
      %{running: running}
    end

    defp check(lifecycle, previous_ns, last_ns, now_ns) do
      event = {:activity_checked, previous_ns, last_ns}
      {lifecycle, []} = Lifecycle.transition(lifecycle, event, now_ns)
      lifecycle
    end

    test "makes it stale once its max_silence has passed", %{running: running} do
      assert check(running, 0, 0, 100 * @ms - 1).status.state == :up
      stale = check(running, 0, 0, 100 * @ms)
      assert %{state: :stale, reason: {:silent, 100}} = stale.status
      assert check(stale, 0, 0, 200 * @ms) == stale
    end

    test "finds it up after a message, even an old one, and then stale again", context do
      stale = check(context.running, 0, 0, 100 * @ms)
      up = check(stale, 0, 50 * @ms, 200 * @ms)
      assert up.status.state == :up
      assert check(up, 50 * @ms, 50 * @ms, 200 * @ms).status.state == :stale
    end

    test "goes on while it stops", %{running: running} do
      {stopping, []} = Lifecycle.transition(running, :stopping, 1)
      assert check(stopping, 0, 0, 100 * @ms).status.state == :stale
    end
  end

  test "an exit that the component has announced is an absence, any other a crash" do
    absent = {:shutdown, {Server, {:absent, :no_answer}}}

    assert Lifecycle.outcome(new(:starting), absent) == {:absent, :no_answer}
    assert Lifecycle.outcome(new(:starting), {:shutdown, {Server, :ignored}}) == :ignored
    assert Lifecycle.outcome(new(:stopping), :unplugged) == {:absent, :unplugged}
    assert Lifecycle.outcome(new(:running), :unplugged) == {:crash, :unplugged}
  end

  test "a retry is counted, and takes the place of the failed run" do
    {backoff, [retry_after: _ms]} =
      Lifecycle.transition(new(:starting), {:start_failed, :no_registry}, 1)

    {retried, [:start]} = Lifecycle.transition(backoff, :retry, 2)
    assert %Status{restarts: 1, state: :backoff, retry_in_ms: nil} = retried.status
  end
end

defmodule BB.Firmware.AttemptTest do
  use ExUnit.Case, async: true

  import ExUnit.CaptureLog

  alias BB.Firmware.Attempt

  # What does not hang has all the time that a busy machine needs.
  @quick [attempts: 2, pause_ms: 0, limit_ms: 30_000]
  @limit_ms ["never returns": 1_000]

  @wrong [
    raises: quote(do: raise("no card")),
    throws: quote(do: throw(:ball)),
    exits: quote(do: exit({:timeout, {GenServer, :call, []}})),
    "exits normally": quote(do: exit(:normal)),
    "is killed": quote(do: Process.exit(self(), :kill)),
    "never returns": quote(do: Process.sleep(:infinity))
  ]

  for {what, code} <- @wrong do
    test "what #{what} is tried again, and then left out" do
      test = self()

      fun = fn ->
        send(test, :tried)
        unquote(code)
      end

      opts = Keyword.put(@quick, :limit_ms, Keyword.get(@limit_ms, unquote(what), 30_000))
      log = capture_log(fn -> assert Attempt.run("take the step", fun, opts) == :error end)
      assert_received :tried
      assert_received :tried
      refute_received _nothing_else
      assert log =~ "could not take the step; the start continues without it"
    end
  end

  test "what succeeds in the end has its result" do
    {:ok, count} = Agent.start_link(fn -> 0 end)

    fun = fn ->
      if Agent.get_and_update(count, &{&1, &1 + 1}) == 0, do: exit(:late), else: :mounted
    end

    capture_log(fn -> assert Attempt.run("mount", fun, @quick) == {:ok, :mounted} end)
    assert Attempt.run("mount", fn -> nil end, @quick) == {:ok, nil}
  end
end

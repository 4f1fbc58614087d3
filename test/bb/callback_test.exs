defmodule BB.CallbackTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import ExUnit.CaptureLog

  alias BB.Callback
  alias BB.Callback.Failures

  doctest BB.Callback

  alias BB.Test.Mischief.{Mute, Shy}

  def perform(fun), do: fun.()
  def even(value) when is_integer(value) and rem(value, 2) == 0, do: {:ok, div(value, 2)}
  def even(_other), do: :error
  def one(1), do: :one

  # A long time limit for callbacks whose result counts; those that hang on purpose get a short
  # one.
  @patience_ms 60_000

  # Each call has a name of its own, under which failures are remembered.
  defp call(fun, opts \\ []) do
    name = opts[:name] || "callback #{System.unique_integer([:positive])}"
    defaults = [name: name, timeout_ms: @patience_ms]
    Callback.call({__MODULE__, :perform, [fun]}, Keyword.merge(defaults, opts))
  end

  defp hang, do: Process.sleep(:infinity)

  # The short time limit may be over before the function starts.
  defp timed_out_after_its_message(hang) do
    assert {:error, {:timeout, 20}} = call(hang, timeout_ms: 20)

    receive do
      {:pids, pids} -> pids
    after
      0 -> nil
    end
  end

  defp gone?(pid), do: eventually(fn -> not Process.alive?(pid) end)

  describe "a call" do
    test "gives what was returned, or what is made of it" do
      assert call(fn -> :value end) == {:ok, :value}
      assert call(fn -> 4 end, accept: &__MODULE__.even/1) == {:ok, 2}
      assert call(fn -> String.duplicate("x", 1_000_000) end) |> elem(0) == :ok
    end

    test "gives in words what was raised, thrown, exited with or returned instead" do
      assert {:error, {:raised, "RuntimeError: boom (" <> _}} = call(fn -> raise "boom" end)

      assert {:error, {:raised, "ArithmeticError: " <> _}} =
               call(fn -> 1 / Process.get(:n, 0) end)

      assert {:error, {:threw, ":ball"}} = call(fn -> throw(:ball) end)
      assert {:error, {:exited, ":gone"}} = call(fn -> exit(:gone) end)
      assert {:error, {:exited, ":normal"}} = call(fn -> exit(:normal) end)
      assert {:error, {:returned, "3"}} = call(fn -> 3 end, accept: &__MODULE__.even/1)
    end

    test "of a function that is not there is a failure like others" do
      assert {:error, {:raised, "UndefinedFunctionError: " <> _}} =
               Callback.call({NoModule, :no_function, []}, timeout_ms: @patience_ms)
    end

    test "ends with the process that kills itself, or is killed by what it is linked to" do
      assert {:error, {:exited, ":killed" <> _}} = call(fn -> Process.exit(self(), :kill) end)

      assert {:error, {:exited, ":broken"}} =
               call(fn ->
                 spawn_link(fn -> exit(:broken) end)
                 hang()
               end)
    end

    test "takes the time that it has, and no more" do
      assert {:error, {:timeout, 20}} = call(&hang/0, timeout_ms: 20)

      busy = fn busy -> busy.(busy) end
      assert {:error, {:timeout, 20}} = call(fn -> busy.(busy) end, timeout_ms: 20)
    end

    test "takes the memory that it has, and no more" do
      assert {:error, {:exited, ":killed" <> _}} = call(fn -> Enum.to_list(1..20_000_000) end)
    end

    test "cannot be hurt by the message of an exception, or by how a term is shown" do
      for how <- [fn -> raise "no" end, fn -> throw(:no) end, fn -> exit(:no) end, fn -> 3 end] do
        assert {:error, {:raised, _}} = call(fn -> raise Mute, how: how end)

        assert {:error, {:returned, _}} =
                 call(fn -> %Shy{how: how} end, accept: &__MODULE__.even/1)

        assert {:error, {:threw, _}} = call(fn -> throw(%Shy{how: how}) end)
      end

      assert {:error, {:timeout, 20}} = call(fn -> raise Mute, how: &hang/0 end, timeout_ms: 20)
      assert {:error, {:timeout, 20}} = call(fn -> throw(%Shy{how: &hang/0}) end, timeout_ms: 20)
    end

    test "has words of a length that one can read" do
      long = String.duplicate("é", 100_000)

      for {fun, opts} <- [
            {fn -> raise long end, []},
            {fn -> throw(long) end, []},
            {fn -> exit({long, long}) end, []},
            {fn -> long end, [accept: &__MODULE__.even/1]},
            {fn ->
               spawn_link(fn -> exit({:shutdown, long}) end)
               hang()
             end, []}
          ] do
        assert {:error, {_how, words}} = call(fun, opts)
        assert String.length(words) < 500 and String.valid?(words)
      end
    end

    test "may lack a clause where that is nothing" do
      call = {__MODULE__, :one, [2]}
      opts = [timeout_ms: @patience_ms]
      assert Callback.call(call, [partial: true] ++ opts) == {:error, :no_clause}
      assert {:error, {:raised, "FunctionClauseError: " <> _}} = Callback.call(call, opts)
      assert Callback.call({__MODULE__, :one, [1]}, [partial: true] ++ opts) == {:ok, :one}

      # A missing clause of another function is a failure.
      assert {:error, {:raised, _}} = call(fn -> one(2) end, partial: true)
    end
  end

  describe "a call leaves" do
    test "no message and no monitor, whatever became of it" do
      call(fn -> :value end)
      call(fn -> raise "boom" end)
      call(&hang/0, timeout_ms: 10)
      call(fn -> Process.exit(self(), :kill) end)
      refute_receive _, 50
      assert Process.info(self(), :monitors) == {:monitors, []}
      assert {:links, []} = Process.info(self(), :links)
    end

    test "no process, and nothing that is linked to it" do
      test = self()

      hang = fn ->
        send(test, {:pids, [self(), spawn_link(&hang/0)]})
        hang()
      end

      pids = eventually(fn -> timed_out_after_its_message(hang) end)
      for pid <- pids, do: assert(gone?(pid))
    end

    test "no process when the caller is killed meanwhile" do
      test = self()

      caller =
        spawn(fn ->
          call(
            fn ->
              send(test, {:pid, self()})
              hang()
            end,
            timeout_ms: 600_000
          )
        end)

      assert_receive {:pid, pid}, 30_000
      Process.exit(caller, :kill)
      assert gone?(pid)
    end
  end

  describe "a function that did not return" do
    test "is not called again, until a minute has passed" do
      name = "a callback that hangs #{System.unique_integer()}"
      test = self()
      call(&hang/0, name: name, timeout_ms: 10)
      assert {:error, {:timeout, _}} = call(fn -> send(test, :called) end, name: name)
      refute_received :called
      Failures.forget(name)
      assert {:ok, :called} = call(fn -> send(test, :called) end, name: name)
    end

    test "is called again where that is wanted" do
      name = "a check that hangs #{System.unique_integer()}"
      call(&hang/0, name: name, timeout_ms: 10, remember: false)
      assert call(fn -> :value end, name: name, remember: false) == {:ok, :value}
    end

    test "hinders no other" do
      calls =
        for n <- 1..20 do
          {fun, timeout_ms} =
            if rem(n, 2) == 0, do: {&hang/0, 500}, else: {fn -> n end, @patience_ms}

          Callback.start(
            {__MODULE__, :perform, [fun]},
            name: "one of twenty, #{n}, #{System.unique_integer()}",
            timeout_ms: timeout_ms
          )
        end

      assert calls |> Enum.map(&Callback.await/1) |> Enum.take_every(2) ==
               for(n <- 1..20//2, do: {:ok, n})
    end
  end

  describe "a failure" do
    test "is said once, with what was called, what it did and what follows" do
      name = {__MODULE__, :"perform#{System.unique_integer([:positive])}", 0}
      opts = [name: name, expected: "an even number", instead: "nothing is shown"]
      opts = [accept: &__MODULE__.even/1] ++ opts

      log =
        capture_log(fn ->
          1..50
          |> Enum.map(fn _ -> Task.async(fn -> call(fn -> 3 end, opts) end) end)
          |> Task.await_many(60_000)
        end)

      said = for line <- String.split(log, "\n"), line =~ elem(name, 1) |> to_string(), do: line

      assert [line] = said
      assert line =~ "was expected to return an even number, got: 3; nothing is shown"
    end

    test "is left to the caller to say, where it is quiet" do
      name = "a quiet callback #{System.unique_integer()}"
      call(fn -> raise "boom" end, name: name, quiet: true)
      assert Failures.log?(name)
      refute Failures.log?(name)
    end
  end
end

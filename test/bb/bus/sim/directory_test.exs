defmodule BB.Bus.Sim.DirectoryTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually

  alias BB.Bus.Sim.Directory

  defmodule Thing do
    @moduledoc false
    use GenServer

    @impl GenServer
    def init(answer), do: answer
  end

  defp registry(test), do: Module.concat(__MODULE__, "Registry#{:erlang.phash2(test)}")

  defp start(test, answer), do: Directory.start_link(Thing, answer, registry(test), "thing")

  # A supervisor traps exits as well.
  setup do
    Process.flag(:trap_exit, true)
    :ok
  end

  test "a start waits for its registry", %{test: test} do
    starting = Task.async(fn -> {start(test, {:ok, nil}), Process.sleep(:infinity)} end)
    ref = Process.monitor(starting.pid)
    start_supervised!({Registry, keys: :unique, name: registry(test)})
    assert eventually(fn -> Directory.fetch(registry(test), "thing") != :error end)
    refute_received {:DOWN, ^ref, _, _, _}
    Task.shutdown(starting, :brutal_kill)
  end

  test "a set of processes is there again after their registry was killed, each time", %{
    test: test
  } do
    start_supervised!({Registry, keys: :unique, name: registry(test)})

    things =
      for name <- ~w(a b c) do
        start = {Directory, :start_link, [Thing, {:ok, nil}, registry(test), name]}
        %{id: name, start: start}
      end

    # One restart for each of them and each time.
    opts = [strategy: :one_for_one, max_restarts: 9, max_seconds: 1_000]
    {:ok, above} = Supervisor.start_link(things, opts)

    for _ <- 1..3 do
      pid = Process.whereis(registry(test))
      {:ok, thing} = Directory.fetch(registry(test), "a")
      Process.exit(pid, :kill)
      assert eventually(fn -> all_there?(registry(test), pid, thing) end)
    end

    assert Process.alive?(above)
  end

  defp all_there?(registry, before, thing) do
    Process.whereis(registry) not in [nil, before] and
      Directory.names(registry) == ~w(a b c) and
      Directory.fetch(registry, "a") != {:ok, thing}
  rescue
    # It is being started.
    ArgumentError -> false
  end

  test "without a registry the start raises", %{test: test} do
    assert_raise ArgumentError, ~r/unknown registry/, fn -> start(test, {:ok, nil}) end
  end

  test "an error of the process, and a name that is taken, are returned at once", %{
    test: test
  } do
    start_supervised!({Registry, keys: :unique, name: registry(test)})
    assert start(test, {:stop, :absent}) == {:error, :absent}
    assert {:ok, pid} = start(test, {:ok, nil})
    assert start(test, {:ok, nil}) == {:error, {:already_started, pid}}
  end
end

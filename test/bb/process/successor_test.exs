defmodule BB.Process.SuccessorTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually

  alias BB.Process.Successor

  # A named supervisor, above a named supervisor, above a named process that ends slowly.
  defmodule Tree do
    @moduledoc false
    use Supervisor

    def start_link(name), do: Supervisor.start_link(__MODULE__, name, name: name)

    def child_spec(name),
      do: %{id: name, start: {__MODULE__, :start_link, [name]}, type: :supervisor}

    @impl Supervisor
    def init(name) do
      middle = %{id: :middle, start: {__MODULE__, :start_middle, [name]}, type: :supervisor}

      Supervisor.init([middle, {Registry, keys: :unique, name: registry(name)}],
        strategy: :one_for_all
      )
    end

    def start_middle(name) do
      leaf = %{id: :leaf, start: {BB.Process.SuccessorTest.Leaf, :start_link, [leaf(name)]}}
      Supervisor.start_link([leaf], strategy: :one_for_one, name: Module.concat(name, Middle))
    end

    def leaf(name), do: Module.concat(name, Leaf)
    def registry(name), do: Module.concat(name, Registry)
  end

  defmodule Leaf do
    @moduledoc false
    use GenServer

    def start_link(name), do: GenServer.start_link(__MODULE__, nil, name: name)

    @impl GenServer
    def init(nil) do
      Process.flag(:trap_exit, true)
      {:ok, nil}
    end

    # It ends when it gets the message, or when the test process has ended.
    @impl GenServer
    def handle_call({:hold_end, holder}, _from, nil), do: {:reply, :ok, holder}

    @impl GenServer
    def terminate(_reason, nil), do: :ok

    def terminate(_reason, holder) do
      ref = Process.monitor(holder)
      send(holder, {:ending, self()})

      receive do
        :end -> :ok
        {:DOWN, ^ref, _, _, _} -> :ok
      end
    end
  end

  # A named supervisor, above one without a name, above a named process.
  defmodule Nameless do
    @moduledoc false
    use Supervisor

    def start_link(name), do: Supervisor.start_link(__MODULE__, name, name: name)

    @impl Supervisor
    def init(name) do
      middle = %{id: :middle, start: {__MODULE__, :start_middle, [name]}, type: :supervisor}
      Supervisor.init([middle], strategy: :one_for_one)
    end

    def start_middle(name) do
      start = {BB.Process.SuccessorTest.Leaf, :start_link, [Tree.leaf(name)]}
      leaf = %{id: :leaf, start: start, shutdown: :infinity}
      Supervisor.start_link([leaf], strategy: :one_for_one)
    end
  end

  defp name(test), do: Module.concat(__MODULE__, "Tree#{:erlang.phash2(test)}")

  test "a start that meets processes of a killed supervisor waits for them, however deep", %{
    test: test
  } do
    name = name(test)

    {:ok, _above} =
      Supervisor.start_link([Successor.child_spec({Tree, name})], strategy: :one_for_one)

    tree = Process.whereis(name)
    leaf = Process.whereis(Tree.leaf(name))
    :ok = GenServer.call(leaf, {:hold_end, self()})
    Process.exit(tree, :kill)
    assert_receive {:ending, ^leaf}, 30_000
    send(leaf, :end)
    assert eventually(fn -> Process.whereis(Tree.leaf(name)) not in [nil, leaf] end, 30_000)
    assert Process.whereis(name) not in [nil, tree]
  end

  test "a process whose supervisor is an orphan, and waits for its end, is waited for too", %{
    test: test
  } do
    name = name(test)
    Process.flag(:trap_exit, true)
    {:ok, tree} = Nameless.start_link(name)
    leaf = Process.whereis(Tree.leaf(name))
    :ok = GenServer.call(leaf, {:hold_end, self()})
    Process.exit(tree, :kill)
    assert_receive {:EXIT, ^tree, :killed}, 30_000
    assert_receive {:ending, ^leaf}, 30_000

    # As every supervisor does.
    starting =
      Task.async(fn ->
        Process.flag(:trap_exit, true)
        {:ok, _successor} = Successor.start_link({Nameless, :start_link, [name]})
        # The successor ends with this process, which is its parent.
        Process.whereis(Tree.leaf(name))
      end)

    assert eventually(fn -> waits_for?(starting.pid, leaf) end, 30_000)
    send(leaf, :end)
    assert Task.await(starting, 30_000) not in [nil, leaf]
  end

  defp waits_for?(pid, other) do
    {:monitors, monitors} = Process.info(pid, :monitors)
    {:process, other} in monitors
  end

  test "a supervisor or registry that is killed costs the one above one restart",
       %{
         test: test
       } do
    name = name(test)

    {:ok, above} =
      Supervisor.start_link([Successor.child_spec({Tree, name})],
        strategy: :one_for_one,
        max_restarts: 20,
        max_seconds: 1_000
      )

    for killed <- [name, Tree.registry(name)], _ <- 1..9 do
      pid = eventually(fn -> Process.whereis(killed) end, 30_000)
      Process.exit(pid, :kill)
      assert eventually(fn -> Process.whereis(killed) not in [nil, pid] end, 30_000)
    end

    assert Process.alive?(above)
  end

  test "a name that another supervisor's process has is taken: the start fails at once", %{
    test: test
  } do
    name = name(test)
    {:ok, _} = Tree.start_link(name)
    tree = Process.whereis(name)
    assert Successor.start_link({Tree, :start_link, [name]}) == {:error, {:already_started, tree}}
  end

  test "what fails for another reason fails at once" do
    assert Successor.start_link({Function, :identity, [{:error, :absent}]}) == {:error, :absent}
    assert Successor.start_link({Function, :identity, [:ignore]}) == :ignore
  end
end

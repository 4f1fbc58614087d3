defmodule BB.Test.ChaosCoreTest do
  @moduledoc "The judge of `bin/chaos core` finds what it looks for."

  use ExUnit.Case, async: true

  alias BB.Test.Chaos.Core.{Robots, Tree, Verdict}

  doctest Verdict

  @second 1_000_000_000
  @ms 1_000_000

  # top, one_for_one: a, group (rest_for_one: x, y, z), keeper ── server.
  defp tree do
    for {place, order, rules} <- [
          {[:top], 0, {:one_for_one, 3, 5}},
          {[:top, :a], 0, nil},
          {[:top, :group], 1, {:rest_for_one, 3, 5}},
          {[:top, :group, :x], 0, nil},
          {[:top, :group, :y], 1, nil},
          {[:top, :group, :z], 2, nil},
          {[:top, :keeper], 2, {:keeper, nil, nil}},
          {[:top, :keeper, :server], 0, nil}
        ],
        into: %{},
        do: {place, node(place, order, rules)}
  end

  defp node(place, order, rules) do
    {strategy, intensity, period_s} = rules || {nil, nil, nil}

    %{
      place: place,
      pid: process(),
      order: order,
      restart: :permanent,
      strategy: strategy,
      intensity: intensity,
      period_s: period_s
    }
  end

  defp process, do: spawn(fn -> :ok end)

  defp expected(tree, victims, ledger \\ [], now_ns \\ 100 * @second) do
    {places, _ledger} = Verdict.expected(tree, victims, ledger, now_ns)
    Enum.sort(places)
  end

  defp restarted(tree, places),
    do: Enum.reduce(places, tree, fn place, tree -> put_in(tree[place].pid, process()) end)

  defp independent(_place, _ended, _all), do: false

  describe "what may be another process" do
    test "is the one that was killed, and all below it" do
      assert expected(tree(), [[:top, :a]]) == [[:top, :a]]
      assert expected(tree(), [[:top, :keeper]]) == [[:top, :keeper], [:top, :keeper, :server]]
      assert expected(tree(), [[:top]]) == Enum.sort(Map.keys(tree()))
    end

    test "is those that its supervisor's strategy says" do
      assert expected(tree(), [[:top, :group, :y]]) == [[:top, :group, :y], [:top, :group, :z]]
      all = put_in(tree()[[:top, :group]].strategy, :one_for_all)
      children = for name <- [:x, :y, :z], do: [:top, :group, name]
      assert expected(all, [[:top, :group, :y]]) == children
      one = put_in(tree()[[:top, :group]].strategy, :one_for_one)
      assert expected(one, [[:top, :group, :y]]) == [[:top, :group, :y]]
    end

    test "is a supervisor whose restarts are used up, as if it had been killed" do
      tree = tree()
      place = [:top, :group, :z]
      ledger = for second <- [96, 97, 98], do: {tree[[:top, :group]].pid, second * @second}
      assert expected(tree, [place], tl(ledger)) == [place]
      group = for {place, _} <- tree, List.starts_with?(place, [:top, :group]), do: place
      assert expected(tree, [place], ledger) == Enum.sort(group)
      assert expected(tree, [place], ledger, 110 * @second) == [place]

      above = for second <- [96, 97, 98], do: {tree[[:top]].pid, second * @second}
      assert expected(tree, [place], ledger ++ above) == Enum.sort(Map.keys(tree))
    end

    test "is none that was started anew since" do
      tree = tree()
      place = [:top, :group, :z]
      ledger = for second <- [96, 97, 98], do: {tree[[:top, :group]].pid, second * @second}
      anew = restarted(tree, [[:top, :group]])
      assert expected(anew, [place], ledger) == [place]
      assert length(expected(tree, [place], ledger)) > 1
    end

    test "is one that may have ended a little earlier, and has not" do
      tree = tree()
      place = [:top, :group, :z]
      ledger = for second <- [96, 97, 98], do: {tree[[:top, :group]].pid, second * @second}

      # It counted 97, 98 and this one.
      {_places, ledger} = Verdict.expected(tree, [place], ledger, 101_500_000_000)
      assert length(expected(tree, [place], ledger, 102_900_000_000)) > 1
    end

    test "is a keeper's child, however often" do
      tree = tree()
      place = [:top, :keeper, :server]
      ledger = List.duplicate({tree[[:top, :keeper]].pid, 100 * @second}, 50)
      assert expected(tree, [place], ledger) == [place]
    end

    test "is used up by several kills at once as well" do
      victims = List.duplicate([:top, :a], 4)
      assert expected(tree(), victims) == Enum.sort(Map.keys(tree()))
      assert expected(tree(), tl(victims)) == [[:top, :a]]
    end
  end

  describe "an innocent restart" do
    test "is another process where the same was to be, or none" do
      before = tree()
      later = before |> restarted([[:top, :a], [:top, :group, :x]]) |> Map.delete([:top, :keeper])
      expected = MapSet.new([[:top, :a]])
      innocent = Verdict.innocent(before, later, expected, &independent/3)
      assert Enum.sort(innocent) == [[:top, :group, :x], [:top, :keeper]]
      assert Verdict.innocent(before, before, expected, &independent/3) == []
    end

    test "is none of one that depends on what has ended" do
      before = tree()
      later = restarted(before, [[:top, :a], [:top, :keeper, :server]])
      due? = fn place, ended, _all -> List.last(place) == :server and [:top, :a] in ended end
      assert Verdict.innocent(before, later, MapSet.new([[:top, :a]]), due?) == []
      assert [_, _] = Verdict.innocent(before, later, MapSet.new(), due?)
    end

    test "is one of a shared bus that somebody still has open" do
      buses = BB.Bus.I2C.Supervisor
      server = [Ganglion.Supervisor, buses, buses, BB.Bus.I2C.Servers, {BB.Bus.I2C.Server, 1}]

      [one, other] =
        for robot <- Robots.all(),
            do: [robot, BB.TopologySupervisor, BB.SensorSupervisor, {:sensor, :imu}, :imu]

      registry = [hd(Robots.all()), Module.concat(hd(Robots.all()), Registry)]
      all = [server, one, other, registry]
      assert Robots.due?(server, MapSet.new([one, other]), all)
      assert Robots.due?(server, MapSet.new([registry, other]), all)
      refute Robots.due?(server, MapSet.new([registry]), all)
      refute Robots.due?(server, MapSet.new([other]), all)
      refute Robots.due?(server, MapSet.new(), [server])
    end

    test "is one of a keeper or a supervisor that comes late, and none of a component" do
      robot = hd(Robots.all())
      keeper = [robot, BB.TopologySupervisor, BB.SensorSupervisor, {:sensor, :camera}]
      camera = keeper ++ [:camera]
      ended = MapSet.new([keeper, camera])
      assert Robots.late?(camera, ended, [keeper, camera])
      refute Robots.late?(keeper, ended, [keeper, camera])

      refute Robots.late?(
               [robot, BB.TopologySupervisor, BB.SensorSupervisor, {:sensor, :imu}, :imu],
               ended,
               [keeper, camera]
             )
    end
  end

  test "a robot is unwatched when it is armed without a warden for longer than 100 ms" do
    short = {:robot, 0, 100 * @ms}
    long = {:robot, 0, 101 * @ms}
    assert Verdict.unwatched([short, long], []) == [long]
    assert Verdict.unwatched([long], [{50 * @ms, 60 * @ms}]) == []
    assert Verdict.unwatched([long], [{200 * @ms, 300 * @ms}]) == [long]
  end

  test "a value is lost when it is none of those that it may be" do
    possible = [1] |> Verdict.possible(2, :unknown) |> Verdict.possible(3, :unknown)
    for value <- 1..3, do: refute(Verdict.lost?({:ok, value}, possible))
    assert Verdict.lost?({:ok, 0}, possible)
    assert Verdict.lost?({:ok, 1}, Verdict.possible(possible, 4, :ok))
    refute Verdict.lost?(:unknown, [1])
  end

  defmodule Group do
    use Supervisor
    def start_link(name), do: Supervisor.start_link(__MODULE__, nil, name: name)

    @impl true
    def init(nil) do
      children = [
        Supervisor.child_spec({Agent, fn -> 1 end}, id: :first),
        {DynamicSupervisor, strategy: :one_for_one, max_restarts: 7},
        Supervisor.child_spec({Agent, fn -> 2 end}, id: :last, restart: :temporary)
      ]

      Supervisor.init(children, strategy: :rest_for_one, max_restarts: 4, max_seconds: 9)
    end
  end

  test "a tree is read from its supervisors, in the order of the starts, and a keeper is one" do
    name = Module.concat(__MODULE__, "Group#{System.unique_integer([:positive])}")
    start_supervised!({Group, name})
    tree = Tree.snapshot([name, :nobody])
    assert %{strategy: :rest_for_one, intensity: 4, period_s: 9} = tree[[name]]
    assert %{strategy: :one_for_one, intensity: 7} = tree[[name, DynamicSupervisor]]
    assert %{order: 0, restart: :permanent, strategy: nil} = tree[[name, :first]]
    assert %{order: 2, restart: :temporary} = tree[[name, :last]]
    assert map_size(tree) == 4
  end
end

defmodule BB.Safety.ModelTest do
  @moduledoc """
  The state machine of `docs/guides/safety.md` beside a plain model of it: robots that start, stop
  and are killed, handlers and vouchers inside and outside of them, and whoever serves safety
  killed meanwhile, in every order.

  Each step waits until what follows from it has happened, and no longer.
  """

  # It kills what serves all robots of the VM.
  use ExUnit.Case, async: false
  use BB.Test.Prop

  import BB.Test.Eventually
  import BB.Test.Robot

  alias BB.Safety
  alias BB.Test.{Application, Brake}

  @moduletag timeout: 600_000
  @patience_ms 30_000

  # Once the property has failed, its smaller failures are looked for with less of it.
  @little_patience_ms 1_000

  @most_steps 150

  # Of the robot's own components, and of processes outside.
  @inside [:a]
  @watcher [:watcher]
  @handlers [[:h1], [:h2]]
  @watched [[:w1], [:w2]]

  # A root restarts its topology three times in five seconds.
  @most_topologies 2

  defmodule Watcher do
    @moduledoc "A component that vouches for its path when it is told to."
    use BB.Sensor

    @impl BB.Sensor
    def init(opts), do: {:ok, opts[:bb]}

    @impl BB.Sensor
    def handle_call(:vouch, _from, bb), do: {:reply, Safety.vouch(bb.robot, bb.path), bb}
  end

  # Most steps make the robot ready to be armed, so that most blows strike one that is.
  defp step do
    frequency([
      {12, :arm},
      {6, :start},
      {6, tuple([:allow, oneof([@watcher | @watched])])},
      {6, tuple([:vouch, oneof(@watched)])},
      {4, tuple([:register, oneof(@handlers)])},
      {2, :vouch_inside},
      {3, :disarm},
      {4, :force_disarm},
      {4, oneof([:stop, :kill_root, :kill_topology])},
      {4, tuple([:end, oneof(@handlers ++ @watched)])},
      {1, tuple([:inhibit, oneof([@watcher | @watched])])},
      {4, tuple([:behave, oneof([@inside | @handlers]), frequency([{4, :well}, {1, :badly}])])},
      {4, tuple([:kill, oneof([:warden, Safety.Wardens, Safety.Supervisor, Safety.HostWatch])])},
      {2, tuple([:application, oneof([:stopped, :killed])])},
      {6, {:application, :started}}
    ])
  end

  defp steps, do: :proper_types.resize(@most_steps, list(step()))

  property "safety does as the model does", numtests: 150, max_shrinks: 40 do
    forall steps <- steps() do
      robot = declared()
      world = %{robot: robot, tree: nil, processes: %{}}

      try do
        {world, model} = Enum.reduce(steps, {world, new()}, &take/2)

        # In the end everyone dies, and whatever was armed is disarmed.
        last = [:stop | Enum.map(@watched ++ @handlers, &{:end, &1})]
        Enum.reduce(last, {world, model}, &take/2)
      after
        Application.start()
      end

      true
    end
  end

  defp take(step, {world, model}) do
    {expected, model} = expect(step, model)
    {answer, world} = perform(step, world, model)
    assert {step, answer} == {step, expected}
    assert_same(step, world, model)
    {world, model}
  end

  defp declared do
    robot do
      sensors do
        sensor :a, BB.Test.Brake
        sensor :watcher, BB.Safety.ModelTest.Watcher
      end
    end
  end

  defp assert_same(step, %{robot: robot}, model) do
    expected = {step, seen(model)}
    look = fn -> {step, look(robot)} end
    eventually(fn -> look.() == expected end, patience_ms())
  rescue
    ExUnit.AssertionError ->
      Process.put(:failed?, true)
      assert {step, look(robot)} == {step, seen(model)}
  end

  defp patience_ms, do: if(Process.get(:failed?), do: @little_patience_ms, else: @patience_ms)

  defp look(robot) do
    %{
      state: Safety.state(robot),
      known?: Safety.Records.known?(robot),
      epoch?: match?({:ok, _}, Safety.epoch(robot)),
      inhibitions: Safety.inhibitions(robot),
      runs: for(path <- [@inside | @handlers], into: %{}, do: {path, Brake.runs(robot, path)})
    }
  end

  # The model. A process outside is known by its number, a component by `:tree`.
  #
  #   root     whose end ends the arming: :tree, the number of a process that stands in for it, or nil
  #   handlers who has registered which path
  #   vouchers who vouches for which path
  #   alive    the processes that are
  #   because  what inhibits arming besides

  defp new do
    %{
      state: :disarmed,
      root: nil,
      tree?: false,
      topologies: 0,
      hosted?: true,
      handlers: %{},
      vouchers: %{},
      because: %{},
      alive: MapSet.new(),
      next: 0,
      latest: %{},
      badly: MapSet.new(),
      runs: Map.new([@inside | @handlers], &{&1, 0})
    }
  end

  # It has a record as long as there is somebody to watch or something to remember.
  defp known?(model), do: model.root != nil or model.state != :disarmed

  defp seen(model) do
    %{
      state: model.state,
      known?: known?(model),
      epoch?: model.state == :armed,
      inhibitions: Enum.sort(inhibitions(model)),
      runs: model.runs
    }
  end

  defp inhibitions(model) do
    unattended =
      for {path, who} <- model.vouchers, not alive?(model, who), do: {path, :unattended}

    Map.merge(Map.new(unattended), model.because)
  end

  defp alive?(model, :tree), do: model.tree?
  defp alive?(model, n), do: n in model.alive

  defp expect(:arm, m) do
    inhibitions = Enum.sort(inhibitions(m))

    cond do
      not known?(m) -> {{:error, :not_registered}, m}
      m.state == :armed -> {{:error, :already_armed}, m}
      m.state == :error -> {{:error, :in_error}, m}
      not m.hosted? -> {{:error, :not_running}, m}
      inhibitions != [] -> {{:error, {:inhibited, inhibitions}}, m}
      true -> {:ok, %{m | state: :armed}}
    end
  end

  defp expect(:disarm, m) do
    cond do
      not known?(m) -> {{:error, :not_registered}, m}
      m.state == :disarmed -> {{:error, :already_disarmed}, m}
      m.state == :error -> {{:error, :already_in_error}, m}
      true -> {failed(m), disarmed(m)}
    end
  end

  defp expect(:force_disarm, m) do
    cond do
      not known?(m) -> {{:error, :not_registered}, m}
      m.state != :error -> {{:error, :not_in_error}, m}
      true -> {:ok, forgotten(%{m | state: :disarmed})}
    end
  end

  # The tree takes the place of whoever stood in for it.
  defp expect(:start, %{tree?: false} = m) do
    m = m |> disarmed() |> swept()
    handlers = Map.put(m.handlers, @inside, :tree)
    {:ok, %{m | root: :tree, tree?: true, topologies: 0, handlers: handlers}}
  end

  defp expect(blow, %{tree?: true} = m) when blow in [:stop, :kill_root],
    do: {:ok, m |> without_components() |> root_lost(:tree)}

  # Its components die and come back. They are registered again, and vouch no longer. An armed robot
  # is in error, however its handlers went.
  defp expect(:kill_topology, %{tree?: true, topologies: n} = m) when n < @most_topologies do
    armed? = m.state == :armed
    m = m |> without_components() |> disarmed()
    m = if armed?, do: %{m | state: :error}, else: m
    handlers = Map.put(m.handlers, @inside, :tree)
    {:ok, %{m | tree?: true, topologies: n + 1, handlers: handlers}}
  end

  defp expect(:vouch_inside, %{tree?: true} = m), do: {:ok, vouched(m, @watcher, :tree)}

  defp expect({:register, path}, m) do
    {n, m} = process(m, path)
    m = known(m, n)
    {:ok, %{m | handlers: Map.put(m.handlers, path, n)}}
  end

  defp expect({:vouch, path}, m) do
    {n, m} = process(m, path)
    {:ok, m |> known(n) |> vouched(path, n)}
  end

  defp expect({:end, path}, m) do
    n = m.latest[path]

    if n in m.alive,
      do: {:ok, ended(%{m | alive: MapSet.delete(m.alive, n)}, n)},
      else: {:ok, m}
  end

  defp expect({:inhibit, path}, m), do: {:ok, put_in(m.because[path], :because)}

  defp expect({:allow, path}, m),
    do: {:ok, %{m | because: Map.delete(m.because, path), vouchers: Map.delete(m.vouchers, path)}}

  defp expect({:behave, path, :badly}, m), do: {:ok, %{m | badly: MapSet.put(m.badly, path)}}
  defp expect({:behave, path, :well}, m), do: {:ok, %{m | badly: MapSet.delete(m.badly, path)}}
  defp expect({:application, :started}, m), do: {:ok, %{m | hosted?: true}}
  defp expect({:application, _ends}, m), do: {:ok, disarmed(%{m | hosted?: false})}
  defp expect(_nothing, m), do: {:ok, m}

  defp process(m, path) do
    {m.next,
     %{
       m
       | next: m.next + 1,
         alive: MapSet.put(m.alive, m.next),
         latest: Map.put(m.latest, path, m.next)
     }}
  end

  # Who does anything for a robot that has no root stands in for it.
  defp known(m, n), do: if(known?(m), do: m, else: %{swept(m) | root: n})

  defp vouched(m, path, who),
    do: %{m | vouchers: Map.put(m.vouchers, path, who), because: Map.delete(m.because, path)}

  defp without_components(m) do
    dead = fn {path, who} -> {path, if(who == :tree, do: :dead, else: who)} end
    %{m | tree?: false, vouchers: Map.new(m.vouchers, dead), handlers: Map.new(m.handlers, dead)}
  end

  defp ended(m, n) do
    m = if n in Map.values(m.vouchers), do: disarmed(m), else: m
    if m.root == n, do: root_lost(m, n), else: m
  end

  defp root_lost(%{root: root} = m, root), do: forgotten(%{disarmed(m) | root: nil})

  defp forgotten(m), do: if(known?(m), do: m, else: swept(m))

  defp swept(%{state: :disarmed} = m),
    do: %{m | handlers: Map.filter(m.handlers, fn {_path, who} -> alive?(m, who) end)}

  defp swept(m), do: m

  # Each handler runs once. One that ran well and whose process has ended is one no longer.
  defp disarmed(%{state: :armed} = m) do
    runs = Map.new(m.runs, fn {path, n} -> {path, if(m.handlers[path], do: n + 1, else: n)} end)
    state = if failed(m) == :ok, do: :disarmed, else: :error

    left = Map.filter(m.handlers, fn {path, who} -> path in m.badly or alive?(m, who) end)

    %{m | state: state, runs: runs, handlers: left}
  end

  defp disarmed(m), do: m

  defp failed(m) do
    case for {path, _who} <- Enum.sort(m.handlers),
             path in m.badly,
             do: {path, {:returned_error, :stuck}} do
      [] -> :ok
      failures -> {:error, {:disarm_failed, failures}}
    end
  end

  # The world.

  defp perform(:arm, w, _m), do: {Safety.arm(w.robot), w}
  defp perform(:disarm, w, _m), do: {Safety.disarm(w.robot, timeout: @patience_ms), w}
  defp perform(:force_disarm, w, _m), do: {Safety.force_disarm(w.robot), w}

  defp perform(:start, %{tree: nil} = w, _m) do
    tree = start(w.robot)
    await_up(w.robot)
    {:ok, %{w | tree: tree}}
  end

  defp perform(:stop, %{tree: root} = w, _m) when is_pid(root) do
    await_ends(root, fn -> Supervisor.stop(root) end)
    {:ok, %{w | tree: nil}}
  end

  defp perform(:kill_root, %{tree: root} = w, _m) when is_pid(root) do
    await_ends(root, fn -> Process.exit(root, :kill) end)
    {:ok, %{w | tree: nil}}
  end

  # The model has counted this one already.
  defp perform(:kill_topology, %{tree: root} = w, _m) when is_pid(root) do
    if Process.get({root, :topologies}, 0) < @most_topologies do
      Process.put({root, :topologies}, Process.get({root, :topologies}, 0) + 1)
      topology = topology(root)
      await_ends(topology, fn -> Process.exit(topology, :kill) end)
      assert eventually(fn -> topology(root) not in [topology, :restarting] end, @patience_ms)
      await_up(w.robot)
    end

    {:ok, w}
  end

  defp perform(:vouch_inside, %{tree: root} = w, _m) when is_pid(root),
    do: {BB.call(w.robot, :watcher, :vouch, @patience_ms), w}

  defp perform({:register, path}, w, _m),
    do: act(w, path, fn -> Brake.register(w.robot, path) end)

  defp perform({:vouch, path}, w, _m), do: act(w, path, fn -> Safety.vouch(w.robot, path) end)

  defp perform({:end, path}, w, _m) do
    if pid = w.processes[path], do: Application.kill(pid)
    {:ok, w}
  end

  defp perform({:inhibit, path}, w, _m), do: {Safety.inhibit(w.robot, path, :because), w}
  defp perform({:allow, path}, w, _m), do: {Safety.allow(w.robot, path), w}

  defp perform({:behave, path, how}, w, _m) do
    answer = if how == :well, do: :ok, else: {:error, :stuck}
    {Brake.script(w.robot, path, disarm: fn _opts -> answer end), w}
  end

  defp perform({:kill, :warden}, w, _m), do: strike(Module.concat(w.robot, "Safety"), w)

  # When all that starts safety again dies in the same moment, the next call does. The model does
  # not know who is half-way back, and waits.
  defp perform({:kill, name}, w, _m) do
    struck = strike(name, w)

    whole? = fn ->
      Enum.all?([Safety.Supervisor, Safety.HostWatch, Safety.Wardens], &Process.whereis/1)
    end

    eventually(whole?, @patience_ms)
    struck
  end

  defp perform({:application, :started}, w, _m), do: {Application.start(), w}

  defp perform({:application, how}, w, _m) do
    case {how, Process.whereis(Ganglion.Supervisor)} do
      {_how, nil} -> :ok
      {:stopped, _pid} -> Application.stop()
      {:killed, pid} -> Application.kill(pid)
    end

    Application.await_end()
    {:ok, w}
  end

  defp perform(_nothing, w, _m), do: {:ok, w}

  # A process of its own, which stays. The one before it for that path stays too.
  defp act(w, path, fun) do
    test = self()

    pid =
      spawn(fn ->
        send(test, {self(), fun.()})
        Process.sleep(:infinity)
      end)

    receive do: ({^pid, answer} -> {answer, put_in(w.processes[path], pid)})
  end

  defp strike(name, w) do
    if pid = Process.whereis(name), do: Application.kill(pid)
    {:ok, w}
  end

  defp start(robot) do
    test = self()

    spawn(fn ->
      Process.flag(:trap_exit, true)
      {:ok, root} = robot.start_link()
      send(test, {:started, root})
      Process.sleep(:infinity)
    end)

    receive do: ({:started, root} -> root)
  end

  defp await_up(robot) do
    assert BB.Test.Robot.await_all_up(robot)
  end

  # All processes below have ended when this returns.
  defp await_ends(supervisor, blow) do
    refs = for {_path, pid} <- Application.tree(supervisor), do: Process.monitor(pid)
    blow.()
    for ref <- refs, do: receive(do: ({:DOWN, ^ref, :process, _pid, _reason} -> :ok))
  end

  defp topology(root) do
    {_id, pid, _, _} =
      root |> Supervisor.which_children() |> List.keyfind(BB.TopologySupervisor, 0)

    pid
  end
end

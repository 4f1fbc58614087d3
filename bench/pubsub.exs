# The pubsub's figures beside their baselines and peers, in one run: see docs/performance.md.
#
#     bin/bench pubsub [--json]

defmodule Bench.PubSub do
  alias BB.{Message, PubSub}
  alias BB.Math.{Quaternion, Vec3}
  alias BB.Message.Sensor.{Imu, Status}

  @rounds 301
  @warm_up 20
  @calls 100
  @roomy 50_000
  @roomy_receiver 10_000
  @path [:sensor, :base_link, :arm, :imu]
  @attrs [
    orientation: Quaternion.identity(),
    angular_velocity: %Vec3{x: 0.01, y: -0.02, z: 0.03},
    linear_acceleration: %Vec3{x: 0.1, y: 0.2, z: 9.81}
  ]

  # In a process with room for a round's garbage, as the receivers have for its messages: collecting it is nobody's figure.
  def run do
    {pid, ref} = :erlang.spawn_opt(&measure/0, [:monitor, min_heap_size: @roomy])
    receive do: ({:DOWN, ^ref, :process, ^pid, reason} -> :normal = reason)
  end

  defp measure do
    contestants = contestants(receiver(), for(_ <- 1..10, do: receiver())) ++ messages()
    for _ <- 1..@warm_up, contestant <- contestants, do: one_round(contestant)
    # Shuffled, so that nobody always comes after the same one.
    rounds =
      for _ <- 1..@rounds, do: Map.new(Enum.shuffle(contestants), &{&1.name, one_round(&1)})

    Enum.each(contestants, &check/1)

    ns = Map.new(contestants, &{&1.name, median(Enum.map(rounds, fn r -> r[&1.name] end))})

    for %{baseline: baseline} = contestant when baseline != nil <- contestants,
        do: report(contestant, ns)
  end

  # Who is compared with whom. The same processes receive in all cases, so that they differ in nothing but the publisher.

  defp contestants(one, ten) do
    message = Message.new!(Imu, :imu, @attrs)
    filtered = for _ <- 1..99, do: {receiver(), @path, [Status]}
    elsewhere = for n <- 1..999, do: {receiver(), elsewhere(n), []}

    [
      sends("one send", [one], message),
      sends("ten sends", ten, message)
      | Enum.concat([
          publishing("0_subscribers", [], [], "one send", message),
          publishing("1_subscriber", [one], [], "one send", message),
          publishing("10_subscribers", ten, [], "ten sends", message),
          publishing("1_of_100_filtered", [one], filtered, "1_subscriber", message),
          publishing("1_of_1000_elsewhere", [one], elsewhere, "1_subscriber", message)
        ])
    ]
  end

  defp sends(name, pids, message) do
    delivery = {:bb, @path, %{message | robot: name(name)}}
    %{name: name, baseline: nil, run: fn -> send_all(pids, delivery) end, receivers: pids}
  end

  defp send_all([pid | rest], delivery) do
    send(pid, delivery)
    send_all(rest, delivery)
  end

  defp send_all([], _delivery), do: :ok

  # A case and its peer, which is compared with the case itself.
  defp publishing(name, receivers, others, baseline, message) do
    robot = name(name)
    peer = name(name <> "_registry")
    subscriptions = for(pid <- receivers, do: {pid, @path, []}) ++ others
    {:ok, _} = PubSub.start_link(robot)
    {:ok, _} = Registry.start_link(keys: :duplicate, name: peer)
    first_publish(robot, message)

    for {pid, path, types} <- subscriptions do
      ask(pid, fn -> {:ok, _} = PubSub.subscribe(robot, path, message_types: types) end)
      ask(pid, fn -> {:ok, _} = Registry.register(peer, path, types) end)
    end

    [
      %{
        name: name,
        baseline: baseline,
        run: fn -> PubSub.publish(robot, @path, message) end,
        receivers: receivers
      },
      %{
        name: name <> "_registry",
        baseline: name,
        run: fn -> dispatch(peer, @path, message) end,
        receivers: receivers
      }
    ]
  end

  # Siblings, cousins and other branches.
  defp elsewhere(n) do
    near = [:sensor, :base_link, :arm]

    Enum.at([near, [:sensor, :base_link], [:sensor, :head], [:actuator]], rem(n, 4)) ++
      [:"other_#{n}"]
  end

  defp name(name), do: Module.concat(__MODULE__, name)

  # A route is there some milliseconds after a source was first seen.
  defp first_publish(robot, message) do
    :ok = PubSub.publish(robot, @path, message)
    Process.sleep(50)
  end

  defp messages do
    made = fn -> {:ok, %Message{}} = Imu.new(:imu, @attrs) end
    walked = fn -> {:ok, %Imu{}} = walk() end

    [
      %{name: "message_new_imu", baseline: "BB.Options.validate", run: made, receivers: []},
      %{name: "BB.Options.validate", baseline: nil, run: walked, receivers: []}
    ]
  end

  # The same payload by walking the schema.
  defp walk do
    with {:ok, attrs} <- BB.Options.validate(@attrs, Imu.schema()), do: {:ok, struct!(Imu, attrs)}
  end

  # The peer: a registry that is asked at each level.

  defp dispatch(registry, path, message) do
    delivery = {:bb, path, %{message | robot: registry}}
    type = message.payload.__struct__

    for level <- PubSub.ancestor_paths(path) do
      Registry.dispatch(registry, level, fn entries ->
        for {pid, types} <- entries, types == [] or type in types, do: send(pid, delivery)
      end)
    end

    :ok
  end

  # Receivers take what comes, count what is right, and die of anything else.

  defp receiver,
    do: :erlang.spawn_opt(fn -> drain(%{}) end, [:link, min_heap_size: @roomy_receiver])

  defp drain(counts) do
    receive do
      {:bb, @path, %Message{robot: robot, payload: %Imu{}}} when robot != nil ->
        drain(Map.update(counts, robot, 1, &(&1 + 1)))

      {:run, from, fun} ->
        fun.()
        send(from, {self(), :done})
        drain(counts)

      {:counts, from} ->
        send(from, {self(), counts})
        drain(counts)
    end
  end

  defp ask(receiver, fun) do
    send(receiver, {:run, self(), fun})
    receive do: ({^receiver, :done} -> :ok)
  end

  # A round: many calls, timed, then all receivers have to be done.

  defp one_round(%{run: run, receivers: receivers}) do
    :erlang.garbage_collect()
    start = System.monotonic_time(:nanosecond)
    repeat(run, @calls)
    stop = System.monotonic_time(:nanosecond)
    Enum.each(receivers, &counts/1)
    (stop - start) / @calls
  end

  defp repeat(_run, 0), do: :ok

  defp repeat(run, left) do
    run.()
    repeat(run, left - 1)
  end

  defp counts(receiver) do
    send(receiver, {:counts, self()})
    receive do: ({^receiver, counts} -> counts)
  end

  defp check(%{name: name, receivers: receivers}) do
    expected = (@rounds + @warm_up) * @calls

    for receiver <- receivers, counts = counts(receiver), counts[name(name)] != expected do
      raise "#{name}: a subscriber received #{inspect(counts)}, not #{expected}"
    end
  end

  defp median(samples), do: Enum.at(Enum.sort(samples), div(length(samples), 2))

  # Reports.

  defp report(%{name: name, baseline: baseline}, ns) do
    print(%{
      bench: "pubsub",
      case: name,
      ns: Float.round(ns[name], 1),
      baseline: baseline,
      baseline_ns: Float.round(ns[baseline], 1),
      ratio: Float.round(ns[name] / ns[baseline], 2)
    })
  end

  defp print(line) do
    if System.get_env("GANGLION_JSON") == "1",
      do: line |> Ganglion.Json.encode() |> IO.puts(),
      else: IO.puts(text(line))
  end

  defp text(line) do
    "#{String.pad_trailing(line.case, 28)} #{String.pad_leading("#{line.ns}", 10)} ns   " <>
      "#{line.ratio} x #{line.baseline} (#{line.baseline_ns} ns)"
  end
end

Bench.PubSub.run()

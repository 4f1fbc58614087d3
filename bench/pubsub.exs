# Measures the pubsub beside its baselines and peers, in one run: see docs/performance.md.
#
#     bin/bench pubsub [--json]

defmodule Bench.PubSub do
  alias BB.{Message, PubSub}
  alias BB.Math.{Quaternion, Vec3}
  alias BB.Message.Sensor.{Imu, Status}

  @rounds 101
  @warm_up 20
  @calls 2_000
  @calls_alone 50
  @roomy 50_000
  @roomy_receiver 10_000
  @few 1_000
  @crowd 10_000
  @most_seconds 5
  @most_bytes 100_000_000
  @path [:sensor, :base_link, :arm, :imu]
  @attrs [
    orientation: Quaternion.identity(),
    angular_velocity: %Vec3{x: 0.01, y: -0.02, z: 0.03},
    linear_acceleration: %Vec3{x: 0.1, y: 0.2, z: 9.81}
  ]

  # The process has a heap for the garbage of a round, and the receivers for its messages, so that
  # garbage collection is not measured.
  def run do
    for measure <- [&measure/0, &measure_crowd/0] do
      {pid, ref} = :erlang.spawn_opt(measure, [:monitor, min_heap_size: @roomy])
      receive do: ({:DOWN, ^ref, :process, ^pid, reason} -> :normal = reason)
    end
  end

  defp measure do
    contestants = contestants(receiver(), for(_ <- 1..10, do: receiver())) ++ messages()
    for _ <- 1..@warm_up, contestant <- contestants, do: one_round(contestant)
    # Shuffled, so that no contestant always follows the same one.
    rounds =
      for _ <- 1..@rounds, do: Map.new(Enum.shuffle(contestants), &{&1.name, one_round(&1)})

    for %{baseline: baseline} = contestant when baseline != nil <- contestants,
        do: report(contestant, rounds)
  end

  # The same processes receive in all cases, so that the cases differ in the publisher only.

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

  # A case and its peer, whose baseline is the case.
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

  # A stream has a route some milliseconds after its first message.
  defp first_publish(robot, message) do
    :ok = PubSub.publish(robot, @path, message)
    Process.sleep(50)
  end

  defp messages do
    generated = fn -> {:ok, %Message{}} = Imu.new(:imu, @attrs) end
    walked = fn -> {:ok, %Imu{}} = walk() end

    [
      %{name: "message_new_imu", baseline: "BB.Options.validate", run: generated, receivers: []},
      %{name: "BB.Options.validate", baseline: nil, run: walked, receivers: []}
    ]
  end

  # The same payload, validated by walking the schema.
  defp walk do
    with {:ok, attrs} <- BB.Options.validate(@attrs, Imu.schema()), do: {:ok, struct!(Imu, attrs)}
  end

  # The peer: a registry with a lookup at each level of the path.

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

  # Receivers count their messages and keep the last one.

  defp receiver,
    do: :erlang.spawn_opt(fn -> drain(0, nil) end, [:link, min_heap_size: @roomy_receiver])

  defp drain(count, last) do
    receive do
      {:bb, @path, message} ->
        drain(count + 1, message)

      {:run, from, fun} ->
        fun.()
        send(from, {self(), :done})
        drain(count, last)

      {:received, from} ->
        send(from, {self(), {count, last}})
        drain(count, last)
    end
  end

  defp ask(receiver, fun) do
    send(receiver, {:run, self(), fun})
    receive do: ({^receiver, :done} -> :ok)
  end

  defp received(receiver) do
    send(receiver, {:received, self()})
    receive do: ({^receiver, received} -> received)
  end

  # A round without receivers: many calls, timed together, minus the time of as many empty calls.

  defp one_round(%{run: run, receivers: []}) do
    :erlang.garbage_collect()
    (repeated_ns(run) - repeated_ns(fn -> :ok end)) / @calls
  end

  # With receivers each call is timed alone, while all of them wait for a message, as a robot's
  # processes do. In a tight loop they would never sleep, and a slower sender would wake them more
  # often: an unequal comparison.
  defp one_round(%{run: run, receivers: receivers} = contestant) do
    before = Enum.map(receivers, &received/1)
    :erlang.garbage_collect()
    samples = for _ <- 1..@calls_alone, do: alone(run, receivers)

    for {receiver, {count, _}} <- Enum.zip(receivers, before),
        do: check(contestant, receiver, count)

    median(samples) - clock_ns()
  end

  defp repeated_ns(run) do
    start = System.monotonic_time(:nanosecond)
    repeat(run, @calls)
    System.monotonic_time(:nanosecond) - start
  end

  defp alone(run, receivers) do
    Enum.each(receivers, &received/1)
    start = System.monotonic_time(:nanosecond)
    run.()
    System.monotonic_time(:nanosecond) - start
  end

  # The time of two readings of the clock, which each sample contains.
  defp clock_ns, do: median(for _ <- 1..@calls_alone, do: alone(fn -> :ok end, []))

  defp repeat(_run, 0), do: :ok

  defp repeat(run, left) do
    run.()
    repeat(run, left - 1)
  end

  defp check(%{name: name}, receiver, before) do
    expected = name(name)

    case received(receiver) do
      {count, %Message{robot: ^expected, payload: %Imu{}}} when count == before + @calls_alone ->
        :ok

      {count, last} ->
        raise "#{name}: received #{count - before} messages, the last #{inspect(last)}"
    end
  end

  defp median(samples), do: Enum.at(Enum.sort(samples), div(length(samples), 2))

  # A crowd on one path, each subscriber in a process of its own. Measures the time of subscribing
  # one after the other, of receiving a message and of dying, and the memory beside those
  # processes.

  defp measure_crowd do
    few = crowd("crowd_few", @few)
    crowd = crowd("crowd", @crowd)
    check_crowd(crowd)

    for what <- [:subscribe, :publish, :die] do
      print(%{
        bench: "pubsub",
        case: "#{what}_of_#{@crowd}",
        ns: each(crowd, what, @crowd),
        baseline: "#{what}_of_#{@few}",
        baseline_ns: each(few, what, @few),
        ratio: Float.round(each(crowd, what, @crowd) / each(few, what, @few), 2),
        bytes: div(crowd.bytes, @crowd)
      })
    end
  end

  defp each(crowd, what, count), do: Float.round(crowd[what] / count, 1)

  defp check_crowd(%{subscribe: ns, bytes: bytes}) do
    if ns > @most_seconds * 1_000_000_000 or bytes > @most_bytes,
      do: raise("#{@crowd} subscribers took #{ns} ns and #{bytes} bytes")
  end

  defp crowd(name, count) do
    robot = name(name)
    message = Message.new!(Imu, :imu, @attrs)
    {:ok, bus} = PubSub.start_link(robot)
    first_publish(robot, message)
    before = memory(bus)

    {subscribe, pids} = timed(fn -> for _ <- 1..count, do: subscriber(robot) end)
    bytes = memory(bus) - before - Enum.sum(Enum.map(pids, &memory_of/1))
    {publish, :ok} = timed(fn -> PubSub.publish(robot, @path, message) end)
    for pid <- pids, do: receive(do: ({:got, ^pid} -> :ok))

    {die, :ok} =
      timed(fn ->
        for pid <- pids, do: Process.exit(pid, :kill)
        await_none(robot)
      end)

    GenServer.stop(bus)
    %{subscribe: subscribe, publish: publish, die: die, bytes: bytes}
  end

  defp subscriber(robot) do
    bench = self()

    pid =
      spawn(fn ->
        {:ok, _} = PubSub.subscribe(robot, @path)
        send(bench, {:subscribed, self()})
        receive do: ({:bb, @path, _message} -> send(bench, {:got, self()}))
        Process.sleep(:infinity)
      end)

    receive do: ({:subscribed, ^pid} -> pid)
  end

  defp await_none(robot) do
    if PubSub.stats(robot) != [] do
      Process.sleep(1)
      await_none(robot)
    else
      :ok
    end
  end

  defp memory(bus) do
    :erlang.garbage_collect()
    :erlang.garbage_collect(bus)
    :erlang.memory(:total)
  end

  defp memory_of(pid), do: pid |> Process.info(:memory) |> elem(1)

  defp timed(fun) do
    start = System.monotonic_time(:nanosecond)
    result = fun.()
    {System.monotonic_time(:nanosecond) - start, result}
  end

  # Reports.

  # The ratio is the median of the rounds' ratios: a change of the machine's speed affects both.
  defp report(%{name: name, baseline: baseline}, rounds) do
    print(%{
      bench: "pubsub",
      case: name,
      ns: Float.round(median(for round <- rounds, do: round[name]) / 1, 1),
      baseline: baseline,
      baseline_ns: Float.round(median(for round <- rounds, do: round[baseline]) / 1, 1),
      ratio: Float.round(median(for round <- rounds, do: round[name] / round[baseline]), 2)
    })
  end

  defp print(line) do
    if System.get_env("GANGLION_JSON") == "1",
      do: line |> Ganglion.Json.encode() |> IO.puts(),
      else: IO.puts(text(line))
  end

  defp text(line) do
    "#{String.pad_trailing(line.case, 28)} #{String.pad_leading(number(line.ns), 10)} ns   " <>
      "#{line.ratio} x #{line.baseline} (#{number(line.baseline_ns)} ns)" <> memory_text(line)
  end

  defp memory_text(%{bytes: bytes}), do: ", #{bytes} bytes each"
  defp memory_text(_line), do: ""

  defp number(float), do: :erlang.float_to_binary(float, decimals: 1)
end

Bench.PubSub.run()

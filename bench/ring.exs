# Measures the ring beside its baselines, in one run: see docs/performance.md.
#
#     bin/bench ring [--json]

defmodule Bench.Ring do
  alias BB.Ring
  alias BB.Ring.{Message, Native, Publisher, Subscriber}

  # A case and its baseline are measured in turns: a change of the machine's speed affects both.
  @turns 7
  @rounds 15
  @messages 1000
  @rate_hz 1000
  @large 2_000_000
  # As for the native sender: a receiver that is not scheduled for 0.25 s loses no message.
  @depth 256

  def run do
    empty = {"empty NIF call", fn -> median(fn -> Native.nothing() end, 20_000) end}
    memcpy = {"memcpy", fn -> peer_ns("ring_peer", "memcpy", @large, 10) end}
    publishing("publish_48", 48, 20_000, empty)
    publishing("publish_64k", 65_536, 200, empty)
    publishing("publish_2m", @large, 10, memcpy)
    latencies()
  end

  defp publishing(name, size, calls, {baseline, baseline_fun}) do
    names = for suffix <- ["", "_native", "_iceoryx2", "_port"], do: name <> suffix

    measures = [
      baseline_fun,
      fn -> publish(size, calls) end,
      fn -> peer_ns("ring_peer", "publish", size, calls) end,
      fn -> peer_ns("iceoryx2_peer", "publish", size, calls) end,
      fn -> port_write(size, min(calls, 500)) end
    ]

    [baseline_ns | all] = measures |> in_turns() |> Enum.map(&middle/1)
    for {name, ns} <- Enum.zip(names, all), do: report(name, ns, {baseline, baseline_ns})
  end

  defp latencies do
    cases = [
      native_to_native: fn -> native_to_native("ring_peer") end,
      native_to_native_iceoryx2: fn -> native_to_native("iceoryx2_peer") end,
      elixir_to_native: &elixir_to_native/0,
      native_to_elixir: &native_to_elixir/0,
      native_to_elixir_port: &port_to_elixir/0
    ]

    measured = cases |> Keyword.values() |> in_turns() |> Enum.map(&middle_quantiles/1)
    native = hd(measured)

    for {{name, _}, figures} <- Enum.zip(cases, measured),
        do: latency(to_string(name), figures, native)
  end

  defp middle_quantiles(turns),
    do: %{p50: middle(for(t <- turns, do: t.p50)), p99: middle(for(t <- turns, do: t.p99))}

  # The results of each function in each turn.
  defp in_turns(functions) do
    turns = for _ <- 1..@turns, do: for(function <- functions, do: function.())
    turns |> Enum.zip() |> Enum.map(&Tuple.to_list/1)
  end

  defp middle(values), do: values |> Enum.sort() |> Enum.at(div(length(values), 2))

  # Publishing: the median of rounds of many calls, in nanoseconds a call.

  defp publish(size, calls) do
    topic = topic()
    {:ok, publisher} = Publisher.open(topic, depth: 4, max_message_size: size)
    data = :binary.copy(<<7>>, size)
    ns = median(fn -> :ok = Publisher.publish(publisher, data) end, calls)
    {:ok, %{published: published}} = Publisher.info(publisher)
    {:ok, subscriber} = Subscriber.open(topic, start: :latest)
    {:ok, %Message{data: ^data, sequence: last}} = Subscriber.recv(subscriber, 5000)
    true = last + 1 == published and published == (@rounds + 4) * calls
    :ok = Publisher.close(publisher)
    ns
  end

  # The cost of a port for the caller, while the program at the other end reads everything.
  defp port_write(size, calls) do
    sink = ["-c", "exec cat > /dev/null"]

    port =
      Port.open({:spawn_executable, System.find_executable("sh")}, [:binary, :out, args: sink])

    data = :binary.copy(<<7>>, size)
    ns = median(fn -> true = Port.command(port, data) end, calls)
    Port.close(port)
    ns
  end

  defp median(fun, calls) do
    for _ <- 1..4, do: time(fun, calls)
    middle(for _ <- 1..@rounds, do: time(fun, calls))
  end

  defp time(fun, calls) do
    start = System.monotonic_time(:nanosecond)
    repeat(fun, calls)
    (System.monotonic_time(:nanosecond) - start) / calls
  end

  defp repeat(_fun, 0), do: :ok

  defp repeat(fun, left) do
    fun.()
    repeat(fun, left - 1)
  end

  # Latency: stamped messages of 48 bytes at 1 kHz; the receiver sleeps in between.

  defp native_to_native(peer) do
    topic = topic()
    receiver = start(peer, ["receive" | arguments(topic, [])])
    sender = start(peer, ["send" | arguments(topic, rate: @rate_hz)])
    result = result(receiver)
    {_, 0} = await(sender)
    result
  end

  defp elixir_to_native do
    topic = topic()
    {:ok, publisher} = Publisher.open(topic, depth: @depth, max_message_size: 4000)
    receiver = start("ring_peer", ["receive" | arguments(topic, [])])
    await_reader(topic)
    paced(fn n -> :ok = Publisher.publish(publisher, stamped(n)) end)
    result = result(receiver)
    :ok = Publisher.close(publisher)
    result
  end

  defp native_to_elixir do
    topic = topic()
    {:ok, %{ref: ref} = subscriber} = Subscriber.open(topic, active: true)
    sender = start("ring_peer", ["send" | arguments(topic, rate: @rate_hz)])

    ages =
      for n <- 0..(@messages - 1) do
        receive do
          {:bb_ring, ^ref, %Message{data: data, lost: 0}} -> age(data, n)
        after
          10_000 -> raise "no message within ten seconds"
        end
      end

    {_, 0} = await(sender)
    :ok = Subscriber.close(subscriber)
    quantiles(ages)
  end

  defp port_to_elixir do
    port = start("ring_peer", ["port" | arguments(nil, rate: @rate_hz)])
    {ages, <<>>} = Enum.map_reduce(0..(@messages - 1), <<>>, &next_from_port(port, &1, &2))
    Port.close(port)
    quantiles(ages)
  end

  # A port may deliver more or less than one message at once.
  defp next_from_port(_port, n, <<message::binary-size(48), rest::binary>>),
    do: {age(message, n), rest}

  defp next_from_port(port, n, rest) do
    receive do
      {^port, {:data, more}} -> next_from_port(port, n, rest <> more)
    after
      10_000 -> raise "no message within ten seconds"
    end
  end

  # Absolute deadlines in whole milliseconds, the resolution of the BEAM's timers.
  defp paced(fun) do
    start = System.monotonic_time(:millisecond) + 10

    for n <- 0..(@messages - 1) do
      Process.send_after(self(), :now, start + n, abs: true)
      receive do: (:now -> fun.(n))
    end
  end

  defp stamped(n),
    do:
      <<Ring.now_ns()::little-64, n::little-64, n::little-64, n::little-64, n::little-64,
        n::little-64>>

  defp age(data, n) do
    now = Ring.now_ns()

    <<time::little-64, stamps::binary>> = data
    ^stamps = :binary.copy(<<n::little-64>>, 5)

    now - time
  end

  defp quantiles(ages) do
    sorted = Enum.sort(ages)
    at = fn share -> Enum.at(sorted, trunc((length(sorted) - 1) * share)) end
    %{p50: at.(0.5), p99: at.(0.99)}
  end

  # The native peers.

  defp peer_ns(peer, verb, bytes, calls) do
    port =
      start(peer, [
        verb,
        "--bytes",
        "#{bytes}",
        "--rounds",
        "#{@rounds}",
        "--calls",
        "#{calls}"
      ])

    {text, 0} = await(port)
    [_, ns] = Regex.run(~r/"ns":([\d.]+)/, text)
    String.to_float(ns)
  end

  defp result(port) do
    {text, 0} = await(port)
    [_, p50, p99] = Regex.run(~r/"p50_ns":(\d+),"p99_ns":(\d+)/, text)
    %{p50: String.to_integer(p50), p99: String.to_integer(p99)}
  end

  defp start(peer, arguments) do
    path = Path.expand("../_build/comparison/release/#{peer}", __DIR__)
    Port.open({:spawn_executable, path}, [:binary, :exit_status, args: arguments])
  end

  defp await(port, text \\ "") do
    receive do
      {^port, {:data, more}} -> await(port, text <> more)
      {^port, {:exit_status, status}} -> {text, status}
    end
  end

  defp arguments(topic, more) do
    if(topic, do: ["--topic", topic], else: []) ++
      ["--count", "#{@messages}"] ++
      Enum.flat_map(more, fn {key, value} -> ["--#{key}", "#{value}"] end)
  end

  defp await_reader(topic) do
    case Ring.info(topic) do
      {:ok, %{readers: [_]}} -> :ok
      _ -> Process.sleep(1) && await_reader(topic)
    end
  end

  defp topic, do: "bench.#{System.pid()}.#{System.unique_integer([:positive])}"

  # Reports.

  defp report(name, ns, {baseline, baseline_ns}) do
    print(%{
      case: name,
      ns: round1(ns),
      baseline: baseline,
      baseline_ns: round1(baseline_ns),
      ratio: ratio(ns, baseline_ns)
    })
  end

  defp latency(name, measured, native) do
    print(%{
      case: name,
      p50_us: us(measured.p50),
      p99_us: us(measured.p99),
      ns: measured.p50,
      baseline: "native_to_native",
      baseline_ns: native.p50,
      ratio: ratio(measured.p50, native.p50),
      ratio_p99: ratio(measured.p99, native.p99)
    })
  end

  defp print(line) do
    if System.get_env("GANGLION_JSON") == "1" do
      line |> Map.put(:bench, "ring") |> Ganglion.Json.encode() |> IO.puts()
    else
      IO.puts(text(line))
    end
  end

  defp text(%{p50_us: p50, p99_us: p99} = line) do
    "#{String.pad_trailing(line.case, 28)} p50 #{pad(p50)} us   p99 #{pad(p99)} us   " <>
      "#{line.ratio} x / #{line.ratio_p99} x native to native"
  end

  defp text(line),
    do:
      "#{String.pad_trailing(line.case, 28)} #{pad(line.ns)} ns   #{line.ratio} x " <>
        "#{line.baseline} (#{line.baseline_ns} ns)"

  defp pad(number), do: String.pad_leading(to_string(number), 10)
  defp ratio(a, b), do: Float.round(a / b, 2)
  defp us(ns), do: Float.round(ns / 1000, 1)
  defp round1(ns), do: Float.round(ns / 1, 1)
end

Bench.Ring.run()

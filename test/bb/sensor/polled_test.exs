defmodule BB.Sensor.PolledTest do
  use ExUnit.Case, async: true

  alias BB.Message
  alias BB.Message.Sensor.Contact
  alias BB.Sensor.Polled
  alias BB.Test.Bench

  # Its device answers as it is told, one answer a reading, and remembers what was asked of it.
  defmodule Told do
    use Polled,
      options_schema: Polled.options(rate: {1, 1000}, default: 100) ++ [device: [type: :pid]]

    @impl Polled
    def open(opts), do: Agent.get(opts[:device], fn _ -> {:ok, opts[:device]} end)

    @impl Polled
    def measure(device, now_ns) do
      Agent.get_and_update(device, fn
        {[{asked, answer} | answers], log} when asked == :measure ->
          {complete(answer, device), {answers, [{:measured, now_ns} | log]}}

        {[], log} ->
          {{:ok, true, device}, {[], log}}
      end)
    end

    @impl Polled
    def check(device) do
      Agent.get_and_update(device, fn
        {[{:check, answer} | answers], log} -> {answer, {answers, [:checked | log]}}
        {answers, log} -> {:ok, {answers, [:checked | log]}}
      end)
    end

    @impl Polled
    def publish(pressed, sensor),
      do: BB.Sensor.publish(sensor.bb, Message.new!(Contact, sensor.frame_id, pressed: pressed))

    @impl Polled
    def close(device),
      do: Agent.update(device, fn {answers, log} -> {answers, [:closed | log]} end)

    defp complete({:ok, reading}, device), do: {:ok, reading, device}
    defp complete({:none, nil}, device), do: {:none, device}
    defp complete({:none, reason}, device), do: {:none, reason, device}
    defp complete(other, _device), do: other
  end

  setup do
    device = start_supervised!({Agent, fn -> {[], []} end})
    %{bench: Bench.new(Told, %{}), device: device}
  end

  defp tell(device, answers) do
    answers =
      for answer <- answers,
          do: if(match?({:check, _}, answer), do: answer, else: {:measure, answer})

    Agent.update(device, fn {_, log} -> {answers, log} end)
  end

  defp log(device), do: Agent.get(device, fn {_answers, log} -> Enum.reverse(log) end)

  test "two failed readings in a row are overcome, a third ends it with its reason", %{
    bench: bench,
    device: device
  } do
    fail = &{:error, {:failed, &1}}
    tell(device, [fail.(1), fail.(2), {:ok, true}, fail.(3), fail.(4), fail.(5)])
    pid = Bench.start!(bench, device: device)
    assert Bench.reason_of_end(pid) == {:shutdown, {:failed, 5}}
    assert Bench.reading().payload.pressed
    refute_received {:bb, _, _}
  end

  test "at the first and after a failed reading it is checked, and what the check says is a failed reading too",
       %{
         bench: bench,
         device: device
       } do
    tell(device, [{:error, :first}, {:check, {:error, :second}}, {:check, {:error, :third}}])
    pid = Bench.start!(bench, device: device)
    assert Bench.reason_of_end(pid) == {:shutdown, :third}
    assert [:checked, {:measured, _}, :checked, :checked, :closed] = log(device)
  end

  test "a device that was restarted ends it at once, and so does a reading that says so", %{
    bench: bench,
    device: device
  } do
    for {answer, reason} <- [
          {{:error, {:restarted, "i2c-1", 1}}, {:restarted, "i2c-1", 1}},
          {{:stop, :lost}, :lost}
        ] do
      tell(device, [answer])
      assert bench |> Bench.start!(device: device) |> Bench.reason_of_end() == {:shutdown, reason}
      refute_received {:bb, _, _}
    end
  end

  test "nothing new for three readings is no fault, and after that it is", %{
    bench: bench,
    device: device
  } do
    none = List.duplicate({:none, :asleep}, 3)
    tell(device, none ++ [{:ok, true}] ++ none ++ List.duplicate({:none, :asleep}, 3))
    pid = Bench.start!(bench, device: device)
    assert Bench.reason_of_end(pid) == {:shutdown, :asleep}
    assert Bench.reading().payload.pressed
    refute_received {:bb, _, _}
    assert Enum.count(log(device), &match?({:measured, _}, &1)) == 10
  end

  test "nothing new, where that may go on, is none", %{bench: bench, device: device} do
    tell(device, List.duplicate({:none, nil}, 10))
    Bench.start!(bench, device: device)
    assert Bench.reading().payload.pressed
  end

  test "its messages have its name as frame, or the one that is asked for", %{
    bench: bench,
    device: device
  } do
    Bench.start!(bench, device: device)
    assert Bench.reading().frame_id == :sensor
    Bench.stop()
    Bench.start!(bench, device: device, frame_id: :bumper)
    assert Bench.reading(&(&1.frame_id == :bumper))
  end

  test "it is asked at its rate, by the robot's clock", %{bench: bench, device: device} do
    start_supervised!({BB.Clock.Stepped, robot: bench.robot})
    Bench.start!(bench, device: device, rate: 200)
    tell(device, for(_ <- 1..200, do: {:ok, true}))
    :ok = BB.Clock.Stepped.advance(bench.robot, 1_000_000_000)
    times = for {:measured, time_ns} <- log(device), do: time_ns
    assert length(times) == 200

    assert times
           |> Enum.chunk_every(2, 1, :discard)
           |> Enum.all?(fn [a, b] -> b - a == 5_000_000 end)
  end

  test "it is checked each half second", %{bench: bench, device: device} do
    start_supervised!({BB.Clock.Stepped, robot: bench.robot})
    Bench.start!(bench, device: device, rate: 10)
    :ok = BB.Clock.Stepped.advance(bench.robot, 10_000_000_000)
    assert Enum.count(log(device), &(&1 == :checked)) == 20
  end

  test "it gives the device back when it ends, and when it gets new options opens it anew", %{
    bench: bench,
    device: device
  } do
    {:ok, sensor} = Told.init(Bench.options(bench, device: device, rate: 1))
    assert Told.rate(rate: 5) == 5
    {:ok, sensor} = Told.handle_options(Bench.options(bench, device: device, rate: 2), sensor)
    assert log(device) == [:closed]
    assert sensor.loop.period_ns == 500_000_000
    Told.terminate(:normal, sensor)
    assert log(device) == [:closed, :closed]
  end
end

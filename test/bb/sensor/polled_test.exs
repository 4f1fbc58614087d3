defmodule BB.Sensor.PolledTest do
  use ExUnit.Case, async: true

  alias BB.Message
  alias BB.Message.Sensor.Contact
  alias BB.Sensor.Polled
  alias BB.Test.Bench

  doctest Polled

  # A driver whose device returns scripted answers, one for each reading, and logs the calls.
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

  # The reason for which a working sensor stops after these answers.
  defp reason_of_end(bench, device, answers) do
    pid = Bench.start!(bench, device: device)
    Bench.reading()
    Bench.reason_of_end(pid, fn -> tell(device, answers) end)
  end

  # Scripted readings are false, others true.
  defp told do
    receive do
      {:bb, _path, %{payload: %Contact{pressed: pressed}}} -> if(pressed, do: 0, else: 1) + told()
    after
      0 -> 0
    end
  end

  test "two failed readings in a row do not stop it, a third stops it with its reason", %{
    bench: bench,
    device: device
  } do
    fail = &{:error, {:failed, &1}}
    answers = [fail.(1), fail.(2), {:ok, false}, fail.(3), fail.(4), fail.(5)]
    assert reason_of_end(bench, device, answers) == {:shutdown, {:failed, 5}}
    assert told() == 1
  end

  test "after a failed reading it is checked, and a failed check is a failed reading too", %{
    bench: bench,
    device: device
  } do
    answers = [{:error, :first}, {:check, {:error, :second}}, {:check, {:error, :third}}]
    assert reason_of_end(bench, device, answers) == {:shutdown, :third}
    assert List.last(log(device)) == :closed
  end

  test "a device that was restarted stops it at once, and so does {:stop, reason}", %{
    bench: bench,
    device: device
  } do
    for {answer, reason} <- [
          {{:error, {:restarted, "i2c-1", 1}}, {:restarted, "i2c-1", 1}},
          {{:stop, :lost}, :lost}
        ] do
      assert reason_of_end(bench, device, [answer]) == {:shutdown, reason}
    end
  end

  test "three ticks without a new reading are no failure, a fourth is", %{
    bench: bench,
    device: device
  } do
    none = List.duplicate({:none, :asleep}, 3)
    answers = none ++ [{:ok, false}] ++ none ++ none
    assert reason_of_end(bench, device, answers) == {:shutdown, :asleep}
    assert told() == 1
    assert Enum.count(log(device), &match?({:measured, _}, &1)) == 10
  end

  test "ticks without a new reading and without a reason are no failure", %{
    bench: bench,
    device: device
  } do
    tell(device, List.duplicate({:none, nil}, 10) ++ [{:ok, false}])
    Bench.start!(bench, device: device)
    refute Bench.reading().payload.pressed
  end

  test "its messages have its name as frame, or that of its options", %{
    bench: bench,
    device: device
  } do
    Bench.start!(bench, device: device)
    assert Bench.reading().frame_id == :sensor
    Bench.stop()
    Bench.start!(bench, device: device, frame_id: :bumper)
    assert Bench.reading(&(&1.frame_id == :bumper))
  end

  test "it is polled at its rate, by the robot's clock", %{bench: bench, device: device} do
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

  test "it is checked every half second", %{bench: bench, device: device} do
    start_supervised!({BB.Clock.Stepped, robot: bench.robot})
    Bench.start!(bench, device: device, rate: 10)
    :ok = BB.Clock.Stepped.advance(bench.robot, 10_000_000_000)
    assert Enum.count(log(device), &(&1 == :checked)) == 20
  end

  test "it closes the device when it stops, and reopens it with new options", %{
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

  test "a driver that still defines pace/1 is polled at that rate, with a warning" do
    driver = """
    defmodule BB.Sensor.PolledTest.Paced do
      use BB.Sensor.Polled, options_schema: BB.Sensor.Polled.options(rate: {1, 9}, default: 2)

      @impl BB.Sensor.Polled
      def pace(opts), do: 10 * opts[:rate]

      @impl BB.Sensor.Polled
      def open(_opts), do: {:ok, nil}

      @impl BB.Sensor.Polled
      def measure(device, _now_ns), do: {:none, device}

      @impl BB.Sensor.Polled
      def publish(_reading, _sensor), do: :ok

      @impl BB.Sensor.Polled
      def close(_device), do: :ok
    end
    """

    warning = ExUnit.CaptureIO.capture_io(:stderr, fn -> Code.compile_string(driver) end)
    assert warning =~ "pace/1 is deprecated; rename it to poll_rate/1"
    paced = Module.concat(__MODULE__, Paced)
    assert {paced.poll_rate(rate: 2), Told.poll_rate(rate: 2)} == {20, 2}
  end
end

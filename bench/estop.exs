# Measures the time from the edge of an emergency stop to a disarmed robot, on an idle and on a
# busy machine: see docs/performance.md.
#
#     bin/bench estop [--json]

defmodule Bench.EmergencyStop do
  alias BB.Bus.Sim.{Contact, Lines}
  alias BB.Safety

  @line {"gpiochip-bench-estop", 27}
  @presses 500
  @limit_us 5_000

  defmodule Motor do
    use BB.Actuator

    @impl BB.Actuator
    def init(opts), do: {:ok, opts}

    @impl BB.Actuator
    def disarm(_opts), do: :ok

    @impl BB.Actuator
    def handle_command(_message, opts), do: {:noreply, opts}
  end

  defmodule Robot do
    use BB

    topology do
      link :base do
        sensor :estop,
               {BB.Sensor.EmergencyStop,
                line: {"gpiochip-bench-estop", 27}, release: 0.0, rate: 200}

        joint :wheel do
          type :continuous
          actuator :motor, Bench.EmergencyStop.Motor
          link :tyre
        end
      end
    end
  end

  def run do
    # This process is the hand that presses the button: it must not wait for a scheduler.
    Process.flag(:priority, :high)
    {chip, line} = @line
    button = {Contact, pins: [contact: line], normally: :closed}
    {:ok, _} = Lines.start_link(chips: %{chip => [devices: %{button: button}]})
    {:ok, _} = Robot.start_link()
    {:ok, _} = BB.subscribe(Robot, [:state_machine])

    report("idle", for(_ <- 1..@presses, do: press()))
    busy = for _ <- 1..(4 * System.schedulers_online()), do: spawn(&compute/0)
    report("busy", for(_ <- 1..@presses, do: press()))
    Enum.each(busy, &Process.exit(&1, :kill))
  end

  # The times from before the edge until the robot is no longer armed, and until it is disarmed.
  defp press do
    {chip, _} = @line
    arm()
    flush()
    pressed = now()
    :ok = Lines.tell(chip, :button, :press)
    not_armed = await_transition(:disarming)
    safe = await_transition(:disarmed)
    :ok = Lines.tell(chip, :button, :release)
    {not_armed - pressed, safe - pressed}
  end

  defp await_transition(state),
    do: receive(do: ({:bb, _, %{payload: %{to: ^state}} = message} -> message.monotonic_time))

  defp arm do
    unless Safety.arm(Robot) == :ok do
      Process.sleep(1)
      arm()
    end
  end

  defp flush do
    receive do
      {:bb, _, _} -> flush()
    after
      0 -> :ok
    end
  end

  defp compute, do: Enum.reduce(1..100_000, 0, &(&1 + &2)) && compute()

  defp report(load, presses) do
    {stopped, safe} = Enum.unzip(presses)
    row = %{bench: "estop", load: load, not_armed_us: spread(stopped), safe_us: spread(safe)}
    print(row, System.get_env("GANGLION_JSON") == "1")
    true = row.not_armed_us.median < @limit_us
  end

  defp spread(values) do
    sorted = Enum.sort(values)
    at = &(sorted |> Enum.at(round((length(sorted) - 1) * &1)) |> div(1000))
    %{median: at.(0.5), p99: at.(0.99), most: at.(1.0)}
  end

  defp print(row, false) do
    IO.puts(
      "#{row.load}: not armed after #{format(row.not_armed_us)}; " <>
        "disarmed after #{format(row.safe_us)}"
    )
  end

  defp print(row, true), do: IO.puts(Ganglion.Json.encode(row))

  defp format(spread),
    do: "#{spread.median} µs (99 %: #{spread.p99}, maximum: #{spread.most}) of #{@presses}"

  defp now, do: System.monotonic_time(:nanosecond)
end

Bench.EmergencyStop.run()

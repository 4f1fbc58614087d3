# How long after its edge an emergency stop has disarmed the robot, idle and beside a machine that computes: see docs/performance.md.
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
    # It stands for the hand: what it waits for is not its own turn.
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

  # From before the edge is made until the robot is not armed any more, and until its motor is safe.
  defp press do
    {chip, _} = @line
    arm()
    flush()
    pressed = now()
    :ok = Lines.tell(chip, :button, :press)
    not_armed = became(:disarming)
    safe = became(:disarmed)
    :ok = Lines.tell(chip, :button, :release)
    {not_armed - pressed, safe - pressed}
  end

  defp became(state),
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
      "#{row.load}: not armed after #{words(row.not_armed_us)}; disarmed after #{words(row.safe_us)}"
    )
  end

  defp print(row, true), do: IO.puts(Ganglion.Json.encode(row))

  defp words(spread),
    do: "#{spread.median} µs (99 %: #{spread.p99}, most: #{spread.most}) of #{@presses}"

  defp now, do: System.monotonic_time(:nanosecond)
end

Bench.EmergencyStop.run()

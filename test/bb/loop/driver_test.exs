defmodule BB.Loop.DriverTest do
  @moduledoc """
  Drivers as packages for Beam Bots write them: with options that are quantities, and with loops
  that begin in three ways.
  """

  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Robot
  import BB.Unit, only: :sigils

  alias BB.Clock.Stepped
  alias BB.Message.Sensor.PowerState

  defmodule PowerMeter do
    @moduledoc "A sensor with quantities as options, which arms its loop."
    use BB.Sensor

    import BB.Unit
    import BB.Unit.Option

    alias BB.Message.Sensor.PowerState

    @impl BB.Sensor
    def options_schema do
      BB.Options.new!(
        rate: [
          type: unit_type(compatible: :hertz, min: ~u(0.1 hertz), max: ~u(1 kilohertz)),
          default: ~u(2 hertz),
          doc: "Readings a second."
        ],
        shunt: [type: unit_type(compatible: :ohm), default: ~u(100 milliohm)]
      )
    end

    @impl BB.Sensor
    def init(opts) do
      {:ok, %{opts: opts, loop: loop(opts)}}
    end

    @impl BB.Sensor
    def handle_options(opts, state) do
      _ = BB.Loop.cancel(state.loop)
      {:ok, %{state | opts: opts, loop: loop(opts)}}
    end

    @impl BB.Sensor
    def handle_info(:tick, state) do
      {_dt, _skipped, loop} = BB.Loop.tick(state.loop)
      %{robot: robot, path: path} = state.opts[:bb]
      current = 0.05 / BB.Robot.Units.extract_float(convert!(state.opts[:shunt], "ohm"))
      message = BB.Message.new!(PowerState, List.last(path), voltage: 7.4, current: current)
      :ok = BB.publish(robot, [:sensor | path], message)
      {:noreply, %{state | loop: loop}}
    end

    defp loop(opts), do: BB.Loop.arm(BB.Loop.new(opts[:bb], clock: {:rate, opts[:rate]}))
  end

  defmodule Starter do
    @moduledoc "A sensor that never arms its loop: it sends itself the first tick, or starts a timer."
    use BB.Sensor

    import BB.Unit.Option

    @impl BB.Sensor
    def options_schema do
      BB.Options.new!(
        rate: [type: unit_type(compatible: :hertz), required: true],
        first_ms: [type: {:or, [:non_neg_integer, nil]}, default: nil]
      )
    end

    @impl BB.Sensor
    def init(opts) do
      if opts[:first_ms],
        do: Process.send_after(self(), :tick, opts[:first_ms]),
        else: send(self(), :tick)

      {:ok, %{opts: opts, loop: BB.Loop.new(opts[:bb], clock: {:rate, opts[:rate]})}}
    end

    @impl BB.Sensor
    def handle_info(:tick, state) do
      {dt, _skipped, loop} = BB.Loop.tick(state.loop)
      %{robot: robot, path: path} = state.opts[:bb]
      message = BB.Message.new!(PowerState, List.last(path), voltage: dt || 0.0, current: 0.0)
      :ok = BB.publish(robot, [:sensor | path], message)
      {:noreply, %{state | loop: loop}}
    end
  end

  setup do
    robot =
      robot do
        parameters do
          param :rate, type: {:unit, :hertz}, default: ~u(50 hertz), max: ~u(1 kilohertz)
        end

        topology do
          link :base do
            sensor :default, BB.Loop.DriverTest.PowerMeter
            sensor :slow, {BB.Loop.DriverTest.PowerMeter, rate: ~u(30 per_minute)}

            sensor :tuned,
                   {BB.Loop.DriverTest.PowerMeter, rate: param([:rate]), shunt: ~u(50 milliohm)}

            sensor :sender, {BB.Loop.DriverTest.Starter, rate: ~u(50 hertz)}
            sensor :waiter, {BB.Loop.DriverTest.Starter, rate: ~u(50 hertz), first_ms: 1}
          end
        end
      end

    start_supervised!({Stepped, robot: robot})
    start_supervised!(robot)
    await_all_up(robot)
    %{robot: robot}
  end

  defp state(robot, name), do: :sys.get_state(BB.Process.whereis(robot, name)).user_state

  defp await_ticks(robot, name, ticks),
    do: eventually(fn -> state(robot, name).loop.ticks == ticks end)

  defp received(name, payloads \\ []) do
    receive do
      {:bb, [:sensor, :base, ^name], %{payload: payload}} -> received(name, [payload | payloads])
    after
      0 -> Enum.reverse(payloads)
    end
  end

  test "an option has its quantity as it was given, a default too", %{robot: robot} do
    assert state(robot, :default).opts[:rate] == ~u(2 hertz)
    assert state(robot, :default).opts[:shunt] == ~u(100 milliohm)
    assert state(robot, :slow).opts[:rate] == ~u(30 per_minute)
    assert state(robot, :tuned).opts[:rate] == ~u(50 hertz)
  end

  test "a loop that is armed ticks at the rate of the quantity", %{robot: robot} do
    for name <- [:default, :slow, :tuned],
        do: {:ok, _} = BB.subscribe(robot, [:sensor, :base, name])

    :ok = Stepped.advance(robot, 10_000_000_000)
    assert length(received(:default)) == 20
    assert length(received(:slow)) == 5
    tuned = received(:tuned)
    assert length(tuned) == 500
    assert Enum.all?(tuned, &match?(%PowerState{current: 1.0}, &1))
  end

  test "a new rate is a quantity, and the loop that was cancelled ticks at it", %{robot: robot} do
    :ok = BB.Parameter.set(robot, [:rate], ~u(0.1 kilohertz))
    eventually(fn -> state(robot, :tuned).opts[:rate] == ~u(100.0 hertz) end)
    {:ok, _} = BB.subscribe(robot, [:sensor, :base, :tuned])
    :ok = Stepped.advance(robot, 10_000_000_000)
    assert length(received(:tuned)) == 1000
  end

  test "a driver that sends itself the first tick keeps ticking at the rate", %{robot: robot} do
    await_ticks(robot, :sender, 1)
    {:ok, _} = BB.subscribe(robot, [:sensor, :base, :sender])
    :ok = Stepped.advance(robot, 10_000_000_000)
    assert for(%{voltage: dt} <- received(:sender), do: dt) == List.duplicate(0.02, 500)
    assert %{ticks: 501, skipped: 0} = state(robot, :sender).loop
  end

  test "a driver with a first timer of its own keeps ticking at the rate", %{robot: robot} do
    await_ticks(robot, :waiter, 1)
    {:ok, _} = BB.subscribe(robot, [:sensor, :base, :waiter])
    :ok = Stepped.advance(robot, 10_000_000_000)
    assert length(received(:waiter)) == 500
  end

  test "a quantity of another kind or beyond the bounds is refused by its option's name" do
    schema = PowerMeter.options_schema()

    for {rate, reason} <- [
          {~u(5 meter), "The unit `meter` is not compatible with `hertz`"},
          {~u(2 kilohertz), "expected at most 1 kilohertz, got: 2 kilohertz"},
          {50, "Value `50` is not a `BB.Unit` struct"}
        ] do
      assert {:error, error} = BB.Options.validate([rate: rate], schema)
      assert Exception.message(error) == "invalid value for :rate option: #{reason}"
    end
  end
end

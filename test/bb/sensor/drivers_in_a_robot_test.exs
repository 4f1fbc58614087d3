defmodule BB.Sensor.DriversInARobotTest do
  use ExUnit.Case, async: true

  alias BB.Bus.Sim
  alias BB.Message.Sensor.{JointState, PowerState, Range, Status}

  @bus "i2c-drivers-in-a-robot"
  @patience_ms 60_000

  # As in the reference, with a range finder and the computer itself.
  defmodule Robot do
    use BB

    sensors do
      sensor :battery, {BB.Sensor.Ina219, bus: "i2c-drivers-in-a-robot", address: 0x40}
      sensor :board, {BB.Sensor.System, rate: 10}
    end

    topology do
      link :base_link do
        sensor :front, {BB.Sensor.TfLuna, bus: "i2c-drivers-in-a-robot"}

        joint :shoulder do
          type :revolute

          limit lower: ~u(-90 degree),
                upper: ~u(90 degree),
                effort: ~u(10 newton_meter),
                velocity: ~u(60 degree_per_second)

          sensor :encoder, {BB.Sensor.As5600, bus: "i2c-drivers-in-a-robot"} do
            transmission do
              reduction 2.0
              offset ~u(5 degree)
              reversed? true
            end
          end

          link :arm
        end
      end
    end
  end

  @declared_hz %{battery: 10, front: 50, encoder: 100, board: 10}

  @devices %{
    0x40 => {Sim.Ina219, source: [voltage: 11.1, current: 1.5]},
    0x10 => {Sim.TfLuna, source: [distance: 2.5]},
    0x36 => {Sim.As5600, source: [angle: :math.pi() / 2]}
  }

  defp start(opts) do
    start_supervised!({Sim, buses: %{@bus => [devices: @devices] ++ opts}})
    start_supervised!(Robot)
    {:ok, _} = BB.subscribe(Robot, [:sensor])
    {:ok, _} = BB.subscribe(Robot, [:sensor_status], replay: true)
    for name <- Map.keys(@declared_hz), do: await(name, :up)
  end

  defp await(name, state) do
    assert_receive {:bb, [:sensor_status | _],
                    %{frame_id: ^name, payload: %Status{state: ^state} = status}},
                   @patience_ms

    status
  end

  defp drain do
    receive do
      {:bb, [:sensor | _], _} -> drain()
    after
      0 -> :ok
    end
  end

  defp count(counts \\ %{}) do
    receive do
      {:bb, [:sensor | path], _} -> counts |> Map.update(List.last(path), 1, &(&1 + 1)) |> count()
    after
      0 -> counts
    end
  end

  test "each publishes at its path, the encoder in the space of its joint" do
    start([])

    assert_receive {:bb, [:sensor, :battery], %{payload: %PowerState{voltage: 11.1}}},
                   @patience_ms

    assert_receive {:bb, [:sensor, :base_link, :front], %{payload: %Range{range: 2.5}}},
                   @patience_ms

    assert_receive {:bb, [:sensor, :base_link, :shoulder, :encoder],
                    %{frame_id: :shoulder, payload: %JointState{names: [:shoulder]} = state}},
                   @patience_ms

    assert_in_delta hd(state.positions), -:math.pi() / 4 + :math.pi() / 36, 0.001
    assert_receive {:bb, [:sensor, :board], %{payload: %BB.Message.System.Status{}}}, @patience_ms
  end

  test "each that is unplugged is down alone, and is up again when it is plugged in" do
    start([])

    for {name, address} <- [battery: 0x40, front: 0x10, encoder: 0x36] do
      :ok = Sim.unplug(@bus, address)
      assert await(name, :backoff).reason == {:no_answer, @bus, address}
      :ok = Sim.replug(@bus, address)
      await(name, :up)
    end

    refute_received {:bb, [:sensor_status, :board], %{payload: %Status{state: :backoff}}}
    for row <- BB.Sensor.health(Robot), do: assert({row.name, row.state} == {row.name, :up})
  end

  test "each keeps its rate over a minute, to a thousandth, and loses no reading" do
    start_supervised!({BB.Clock.Stepped, robot: Robot})
    clock = BB.Clock.of(Robot)
    start(clock: fn -> BB.Clock.now_ns(clock) end)

    # The chips' first measurements take some time.
    :ok = BB.Clock.Stepped.advance(Robot, 1_000_000_000)
    drain()
    :ok = BB.Clock.Stepped.advance(Robot, 60_000_000_000)
    counts = count()

    for {name, hz} <- @declared_hz,
        do: assert_in_delta(counts[name], hz * 60, max(hz * 0.06, 1), "#{name}: #{counts[name]}")
  end
end

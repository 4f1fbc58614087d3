defmodule BB.Sensor.QuadratureEncoderTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.LineBench

  alias BB.Bus.Sim.{Encoder, Lines}
  alias BB.Message.Sensor.JointState
  alias BB.Sensor.QuadratureEncoder

  doctest QuadratureEncoder

  @pulses 11
  @count 2 * :math.pi() / (4 * @pulses)

  setup do
    start(devices: %{encoder: {Encoder, pins: [a: 5, b: 6], pulses: @pulses}})
  end

  defp encoder!(bench) do
    lines = [a: {bench.chip, 5}, b: {bench.chip, 6}, pulses: @pulses]
    run!(bench, QuadratureEncoder, lines)
  end

  defp last do
    assert %JointState{positions: [position], velocities: [velocity]} = List.last(published())
    {position, velocity}
  end

  test "it publishes at its rate, also while nothing moves", bench do
    pid = encoder!(bench)
    pass(bench, 1, pid)
    states = published()
    assert length(states) == 50

    assert Enum.uniq(states) == [
             %JointState{names: [:subject], positions: [0.0], velocities: [0.0]}
           ]
  end

  test "a turn of the shaft is 2π, in either direction", bench do
    pid = encoder!(bench)
    :ok = Lines.tell(bench.chip, :encoder, {:turn, 4 * @pulses})
    pass(bench, 0.02, pid)
    assert {position, _} = last()
    assert_in_delta position, 2 * :math.pi(), 1.0e-9
    :ok = Lines.tell(bench.chip, :encoder, {:turn, -6 * @pulses})
    pass(bench, 0.02, pid)
    assert {position, _} = last()
    assert_in_delta position, -:math.pi(), 1.0e-9
  end

  for velocity <- [0.5, -3.0, 31.4, -200.0] do
    test "it tells #{velocity} rad/s, and how far that goes in 3 s", bench do
      pid = encoder!(bench)
      :ok = Lines.tell(bench.chip, :encoder, {:velocity, unquote(velocity)})
      pass(bench, 3, pid)
      {position, velocity} = last()
      assert_in_delta position, 3 * unquote(velocity), @count
      assert_in_delta velocity, unquote(velocity), abs(unquote(velocity)) * 0.001
    end
  end

  test "a shaft that stops is still half a second later", bench do
    pid = encoder!(bench)
    :ok = Lines.tell(bench.chip, :encoder, {:velocity, 31.4})
    pass(bench, 1, pid)
    :ok = Lines.tell(bench.chip, :encoder, {:velocity, 0.0})
    pass(bench, 0.6, pid)
    assert {_position, velocity} = last()
    assert velocity == 0.0
  end

  test "when the wire of one line is broken it stops, with both lines in the reason", bench do
    pid = encoder!(bench)
    monitor = Process.monitor(pid)
    :ok = Lines.fault({bench.chip, 6}, :cut)
    :ok = Lines.tell(bench.chip, :encoder, {:velocity, 31.4})
    pass(bench, 2, pid)
    reason = {:one_line, {bench.chip, 5}, {bench.chip, 6}}
    assert_receive {:DOWN, ^monitor, _, _, {:shutdown, ^reason}}
  end

  test "a storm on one line stops it", bench do
    pid = encoder!(bench)
    monitor = Process.monitor(pid)
    :ok = Lines.fault({bench.chip, 5}, {:storm, 20_000})
    pass(bench, 0.1, pid)
    reason = {:one_line, {bench.chip, 5}, {bench.chip, 6}}
    assert_receive {:DOWN, ^monitor, _, _, {:shutdown, ^reason}}
  end

  test "lines that were taken away stop it with the third reading", bench do
    pid = encoder!(bench)
    monitor = Process.monitor(pid)
    :ok = Lines.fault({bench.chip, 6}, :busy)
    pass(bench, 0.06, pid)
    lost = {:line_lost, [{bench.chip, 5}, {bench.chip, 6}]}
    assert_receive {:DOWN, ^monitor, _, _, {:shutdown, ^lost}}
    assert published() == []
  end

  test "on a joint it is in the joint's space and has its name", %{chip: chip} do
    robot =
      BB.Test.Robot.create(
        quote do
          topology do
            link :base do
              joint :wheel do
                type :continuous

                sensor :encoder,
                       {QuadratureEncoder,
                        a: {unquote(chip), 5}, b: {unquote(chip), 6}, pulses: 11} do
                  transmission do
                    reduction 34.0
                    reversed? true
                  end
                end

                link :tyre
              end
            end
          end
        end
      )

    start_supervised!(robot)
    assert eventually(fn -> BB.Test.Robot.health(robot, :encoder).state == :up end)
    {:ok, _} = BB.subscribe(robot, [:sensor, :base, :wheel])
    :ok = Lines.tell(chip, :encoder, {:turn, 4 * @pulses * 34})
    # It is read on the way as well.
    turned_back = await_position(&(&1 < -2 * :math.pi() + 1.0e-9))
    assert_in_delta turned_back, -2 * :math.pi(), 1.0e-9
    assert await_position(fn _position -> true end) == turned_back
  end

  defp await_position(fun) do
    assert_receive {:bb, [:sensor, :base, :wheel, :encoder],
                    %{frame_id: :wheel, payload: %JointState{names: [:wheel], positions: [p]}}}

    if fun.(p), do: p, else: await_position(fun)
  end
end

defmodule BB.Sensor.ContactSwitchTest do
  use ExUnit.Case, async: true

  import BB.Test.LineBench

  alias BB.Bus.Sim.{Contact, Lines}
  alias BB.Message.Sensor
  alias BB.Sensor.ContactSwitch

  @ms 1_000_000
  @period 0.1

  setup context do
    contact = {Contact, [pins: [contact: 17]] ++ Map.get(context, :contact, [])}
    start(devices: %{bumper: contact})
  end

  defp switch!(bench, opts \\ []),
    do: run!(bench, ContactSwitch, [line: {bench.chip, 17}] ++ opts)

  defp contacts, do: for(%Sensor.Contact{pressed: pressed?} <- published(), do: pressed?)

  test "it publishes at its rate, and when it is pressed or released", bench do
    pid = switch!(bench)
    pass(bench, 3.05 * @period, pid)
    assert contacts() == [false, false, false]
    :ok = Lines.tell(bench.chip, :bumper, :press)
    pass(bench, 0.004, pid)
    assert contacts() == []
    pass(bench, 0.001, pid)
    assert contacts() == [true]
    :ok = Lines.tell(bench.chip, :bumper, :release)
    pass(bench, 0.005, pid)
    assert contacts() == [false]
  end

  @tag contact: [bounce_ns: 4 * @ms, bounces: 5]
  test "a bouncing contact is one change", bench do
    pid = switch!(bench)
    :ok = Lines.tell(bench.chip, :bumper, :press)
    pass(bench, 0.09, pid)
    assert contacts() == [true]
  end

  test "a disturbance shorter than the debounce time is no change", bench do
    pid = switch!(bench, debounce: BB.Unit.new!(2, :millisecond))
    :ok = Lines.drive({bench.chip, 17}, 0)
    pass(bench, 0.001, pid)
    :ok = Lines.drive({bench.chip, 17}, :z)
    pass(bench, 0.05, pid)
    assert contacts() == []
  end

  @tag contact: [normally: :closed]
  test "a contact that is normally closed is pressed when it opens or its wire breaks", bench do
    pid = switch!(bench, pressed: :high)
    pass(bench, @period, pid)
    assert contacts() == [false]
    :ok = Lines.fault({bench.chip, 17}, :cut)
    pass(bench, 0.01, pid)
    assert contacts() == [true]
  end

  @tag contact: [to: :supply]
  test "a contact to the supply needs a pull-down", bench do
    pid = switch!(bench, pressed: :high, pull: :pulldown)
    pass(bench, @period, pid)
    :ok = Lines.tell(bench.chip, :bumper, :press)
    pass(bench, 0.005, pid)
    assert contacts() == [false, true]
  end

  test "a contact pressed before the start is pressed in the first message", bench do
    :ok = Lines.tell(bench.chip, :bumper, :press)
    pid = switch!(bench)
    pass(bench, @period, pid)
    assert contacts() == [true]
  end

  test "a storm of edges stops it with :noise, and publishes nothing old meanwhile", bench do
    pid = switch!(bench)
    :ok = Lines.fault({bench.chip, 17}, {:storm, 10_000})
    Process.flag(:trap_exit, true)
    monitor = Process.monitor(pid)
    pass(bench, 1, pid)
    noise = {:noise, {bench.chip, 17}}
    assert_receive {:DOWN, ^monitor, _, _, {:shutdown, ^noise}}
    assert BB.Sensor.explain(ContactSwitch, noise) =~ "changes all the time"
  end

  test "a line that was taken away stops it, with the reason", bench do
    pid = switch!(bench)
    :ok = Lines.fault({bench.chip, 17}, :busy)
    monitor = Process.monitor(pid)
    pass(bench, 3 * @period, pid)
    lost = {:line_lost, {bench.chip, 17}}
    assert_receive {:DOWN, ^monitor, _, _, {:shutdown, ^lost}}
    assert contacts() == []
    assert {:error, reason} = run(bench, ContactSwitch, line: {bench.chip, 17})
    assert inspect(reason) =~ "line_busy"
  end

  test "it gives its line back", bench do
    pid = switch!(bench)
    assert %{open?: true} = Lines.describe({bench.chip, 17})
    GenServer.stop(pid)
    assert %{open?: false} = Lines.describe({bench.chip, 17})
  end
end

defmodule BB.Bus.Sim.HcSr04Test do
  use ExUnit.Case, async: true

  alias BB.Bus.Sim.HcSr04

  defp module(opts) do
    {:ok, module, [{:drive, :echo, 0}]} = HcSr04.init(opts, 0)
    module
  end

  defp width({_module, [{:drive, :echo, 1, rise_ns}, {:drive, :echo, 0, fall_ns}]}),
    do: fall_ns - rise_ns

  test "the echo is as wide as sound takes there and back" do
    assert width(HcSr04.level(:trigger, 0, 0, module(distance: 1.716))) == 10_000_000
  end

  test "without a thing in reach it is 38 ms wide" do
    for distance <- [:infinity, 10],
        do: assert(width(HcSr04.level(:trigger, 0, 0, module(distance: distance))) == 38_000_000)
  end

  test "until the echo has ended it takes no other trigger" do
    {module, [_, {:drive, :echo, 0, fall_ns}]} = HcSr04.level(:trigger, 0, 0, module([]))
    assert {_, []} = HcSr04.level(:trigger, 0, fall_ns - 1, module)
    assert {_, [_, _]} = HcSr04.level(:trigger, 0, fall_ns, module)
  end

  test "a distance may move with time" do
    moving = module(distance: &(1.0 + &1))
    at_rest = module(distance: 3.0)

    assert width(HcSr04.level(:trigger, 0, 2_000_000_000, moving)) ==
             width(HcSr04.level(:trigger, 0, 0, at_rest))
  end

  test "wrong options raise with the expected ones" do
    assert_raise ArgumentError, ~r/expected a distance/, fn -> module(distance: -1) end
    assert_raise ArgumentError, fn -> module(range: 1) end
    assert HcSr04.order(:ping, 0, module([])) == :error
  end
end

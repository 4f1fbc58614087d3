defmodule BB.Firmware.Network.OperatorTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  alias BB.Firmware.Network.Operator

  doctest Operator

  test "without a declaration nothing ever follows" do
    assert {_, :nothing} = Operator.handle(Operator.new(nil), :tick, true, 1_000_000)
  end

  property "a robot is disarmed exactly when it was armed and heard nobody for so long",
    numtests: 1_000 do
    step = {integer(0, 60), oneof([:sign, :tick]), frequency([{5, true}, {1, false}])}

    forall steps <- list(step) do
      Enum.reduce(steps, {0, Operator.new(100), nil}, fn {gap, event, armed?},
                                                         {now, operator, last} ->
        now = now + gap
        {operator, what} = Operator.handle(operator, event, armed?, now)

        # When the last of arming, sign and disarming was, kept beside it.
        due? = armed? and event == :tick and last != nil and now - last >= 100
        assert what == if(due?, do: :disarm, else: :nothing)

        last =
          cond do
            not armed? -> nil
            event == :sign or due? or last == nil -> now
            true -> last
          end

        {now, operator, last}
      end)

      true
    end
  end
end

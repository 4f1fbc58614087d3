defmodule BB.Firmware.Applications.RestartPolicyTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  alias BB.Firmware.Applications.RestartPolicy

  doctest RestartPolicy

  defp steps(policy, ends) do
    {_decision, steps} =
      Enum.reduce(ends, {policy, []}, fn {app, reason, at}, {policy, steps} ->
        {policy, step} = RestartPolicy.handle_end(policy, app, reason, at)
        {policy, steps ++ [step]}
      end)

    steps
  end

  test "an application that ends is started again, each time later, and then that is given up" do
    ends = for n <- 0..5, do: {:ganglion, :killed, n * 400}

    assert steps(RestartPolicy.new([]), ends) == [
             {:start, 1, 0},
             {:start, 2, 1_000},
             {:start, 3, 5_000},
             {:start, 4, 15_000},
             :give_up,
             :give_up
           ]
  end

  test "ends long ago do not count, and each application counts for itself" do
    day_ms = 86_400_000
    ends = for n <- 0..9, do: {:ganglion, :killed, n * day_ms}
    assert Enum.uniq(steps(RestartPolicy.new([]), ends)) == [{:start, 1, 0}]

    assert [_, {:start, 1, 0}] =
             steps(RestartPolicy.new([]), [{:a, :killed, 0}, {:b, :killed, 1}])
  end

  test "an application that a person has stopped stays stopped, and nothing is held against it" do
    assert [{:start, 1, 0}, :nothing, {:start, 1, 0}] =
             steps(RestartPolicy.new([]), [{:a, :killed, 0}, {:a, :stopped, 1}, {:a, :killed, 2}])
  end

  test "wrong options are refused" do
    assert_raise BB.Options.ValidationError, fn -> RestartPolicy.new(window_ms: 0) end
  end

  property "within a window there are never more starts than there are pauses", numtests: 300 do
    forall gaps <- list(integer(0, 400_000)) do
      times = Enum.scan([0 | gaps], &(&1 + &2))
      steps = steps(RestartPolicy.new([]), for(at <- times, do: {:a, :killed, at}))
      started = for {at, {:start, _, _}} <- Enum.zip(times, steps), do: at

      for at <- started,
          do: assert(Enum.count(started, &(&1 in (at - 299_999)..at)) <= 4)

      true
    end
  end
end

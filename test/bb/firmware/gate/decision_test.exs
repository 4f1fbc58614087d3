defmodule BB.Firmware.Gate.DecisionTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  alias BB.Firmware.Gate.Decision

  doctest Decision

  @good %{
    safety: [:disarmed, :error],
    validation: [:validated, :unknown],
    lock: [:ok],
    key: [{:ok, "/key"}]
  }
  @bad %{
    safety: [:armed, :disarming],
    validation: [:unvalidated, {:error, :timeout}],
    lock: [{:error, :updating}, {:error, :written}],
    key: [{:error, {"/key", "is missing"}}]
  }

  property "an update is let in only when nothing at all speaks against it", numtests: 1_000 do
    facts =
      for name <- Map.keys(@good),
          do: {name, frequency([{3, oneof(@good[name])}, {1, oneof(@bad[name])}])}

    forall facts <- facts do
      facts = Map.new(facts)
      good? = Enum.all?(facts, fn {name, fact} -> fact in @good[name] end)

      case Decision.decide(facts) do
        :ok -> assert good?
        {:error, text} -> assert not good? and is_binary(text) and String.valid?(text)
      end
    end
  end
end

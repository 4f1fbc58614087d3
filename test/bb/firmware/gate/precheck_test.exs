defmodule BB.Firmware.Gate.PrecheckTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  alias BB.Firmware.Gate.Precheck

  doctest Precheck

  @good %{
    safety: [:disarmed, :error],
    validation: [:validated, :unknown],
    lock: [:ok],
    key: [{:ok, "/key"}],
    gate: [:running, :not_running]
  }
  @bad %{
    safety: [:armed, :disarming],
    validation: [:unvalidated, {:error, :timeout}],
    lock: [{:error, :updating}, {:error, :written}, {:error, :unknown}],
    key: [{:error, {"/key", "is missing"}}],
    gate: [:running]
  }

  property "an update is let in only when nothing at all speaks against it", numtests: 1_000 do
    facts =
      for name <- Map.keys(@good),
          do: {name, frequency([{3, oneof(@good[name])}, {1, oneof(@bad[name])}])}

    forall facts <- facts do
      facts = Map.new(facts)
      gone? = facts.gate == :not_running and match?({:error, _}, facts.validation)

      good? =
        Enum.all?(facts, fn {name, fact} ->
          fact in @good[name] or (name == :validation and gone?)
        end)

      case Precheck.decide(facts) do
        :ok -> assert good?
        {:error, text} -> assert not good? and is_binary(text) and String.valid?(text)
      end
    end
  end
end

defmodule BB.Command.AdmissionTest do
  use ExUnit.Case, async: true

  alias BB.Command.Admission
  alias BB.Dsl.Command
  alias BB.Error.{Category, State}

  doctest Admission

  @idle %{safety: :armed, operational: :idle, running: [], limits: %{default: 1, motion: 2}}

  defp command(fields \\ []), do: struct!(%Command{name: :go, category: :default}, fields)

  defp running(categories),
    do: %{@idle | running: for(category <- categories, do: %{id: make_ref(), category: category})}

  test "no command starts while the robot is being disarmed or is in error" do
    always = command(allowed_states: [:*])
    assert Admission.decide(always, %{@idle | safety: :disarming}) == {:error, :disarming}
    assert Admission.decide(always, %{@idle | safety: :error}) == {:error, :safety_error}
  end

  test "a disarmed robot allows commands with :disarmed or :*" do
    disarmed = %{@idle | safety: :disarmed}
    assert Admission.decide(command(allowed_states: [:disarmed]), disarmed) == :start
    assert Admission.decide(command(allowed_states: [:*]), disarmed) == :start

    assert {:error, %State.NotAllowed{operation: :go, current_state: :disarmed} = error} =
             Admission.decide(command(), disarmed)

    assert error.allowed_states == [:idle]
  end

  test "an armed robot allows commands of its operational state" do
    driving = %{@idle | operational: :driving}
    assert Admission.decide(command(allowed_states: [:idle, :driving]), driving) == :start

    assert {:error, %State.NotAllowed{current_state: :driving}} =
             Admission.decide(command(), driving)

    assert {:error, %State.NotAllowed{current_state: :idle}} =
             Admission.decide(command(allowed_states: [:disarmed]), @idle)
  end

  test ":executing is allowed while commands run in :idle" do
    executing = command(category: :motion, allowed_states: [:executing])
    assert Admission.decide(executing, running([:default])) == :start
    assert {:error, %State.NotAllowed{}} = Admission.decide(executing, @idle)
    driving = %{running([:default]) | operational: :driving}
    assert {:error, %State.NotAllowed{}} = Admission.decide(executing, driving)
  end

  test "a category holds as many commands as its limit says" do
    motion = command(category: :motion)
    assert Admission.decide(motion, running([:motion, :default])) == :start

    assert Admission.decide(motion, running([:motion, :motion])) ==
             {:error, %Category.Full{category: :motion, limit: 2, current: 2}}

    unknown = command(category: :unknown)
    assert Admission.decide(unknown, @idle) == :start
    assert {:error, %Category.Full{limit: 1}} = Admission.decide(unknown, running([:unknown]))
  end

  test "a command preempts the categories that it cancels" do
    situation = running([:motion, :default, :motion])
    [one, other, third] = for execution <- situation.running, do: execution.id
    assert Admission.decide(command(cancel: [:motion]), situation) == {:preempt, [one, third]}
    assert Admission.decide(command(cancel: [:*]), situation) == {:preempt, [one, other, third]}
    assert Admission.decide(command(cancel: [:default]), situation) == {:preempt, [other]}
    assert Admission.decide(command(cancel: [:motion]), running([])) == :start
  end

  test "a command that is not allowed preempts nothing" do
    situation = %{running([:motion]) | safety: :error}
    assert Admission.decide(command(cancel: [:*]), situation) == {:error, :safety_error}
  end
end

defmodule BB.Sensor.EmergencyStop.DecisionTest do
  use ExUnit.Case, async: true

  alias BB.Sensor.EmergencyStop.Decision

  doctest Decision

  defp released, do: :closed |> Decision.new(100) |> elem(1)
  defp halted, do: :open |> Decision.new(100) |> elem(1)

  test "what is found open is halted" do
    assert {:halted, %{state: :halted}} = Decision.new(:open, 100)
  end

  test "an open contact halts, with or without an edge before" do
    assert {:halt, %{state: :halted}} = Decision.see(released(), :open, 0)
    assert {:halt, %{state: :halted}} = Decision.edge(released())
  end

  test "it is released when it was closed for the whole time, and not before" do
    {:listen, d} = Decision.see(halted(), :closed, 0)
    assert {:stay, d} = Decision.see(d, :closed, 99)
    assert {:release, %{state: :released}} = Decision.see(d, :closed, 100)
  end

  test "the time begins anew when it was open, or an edge was told, meanwhile" do
    {:listen, d} = Decision.see(halted(), :closed, 0)
    {:stay, opened} = Decision.see(d, :open, 50)
    assert {:listen, _} = Decision.see(opened, :closed, 100)
    {:wait, shaken} = Decision.edge(d)
    assert {:listen, d} = Decision.see(shaken, :closed, 100)
    assert {:stay, _} = Decision.see(d, :closed, 150)
  end

  test "an edge each time that it may soon be released is noise, after twenty-five of them" do
    verdicts =
      Stream.unfold(halted(), fn d ->
        {:listen, d} = Decision.see(d, :closed, 0)
        Decision.edge(d)
      end)

    assert Enum.find_index(verdicts, &(&1 == :restless)) == 24
  end

  test "a hand that plays with it, twenty times, is none" do
    Enum.reduce(1..20, halted(), fn _, d ->
      {:listen, d} = Decision.see(d, :closed, 0)
      {:wait, d} = Decision.edge(d)
      {:stay, d} = Decision.see(d, :open, 0)
      d
    end)
  end
end

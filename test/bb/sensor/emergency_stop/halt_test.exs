defmodule BB.Sensor.EmergencyStop.HaltTest do
  use ExUnit.Case, async: true

  alias BB.Sensor.EmergencyStop.Halt

  doctest Halt

  defp released, do: :closed |> Halt.new(100) |> elem(1)
  defp halted, do: :open |> Halt.new(100) |> elem(1)

  test "an open contact at the start is halted" do
    assert {:halted, %{state: :halted}} = Halt.new(:open, 100)
  end

  test "an open contact halts, with or without an edge before" do
    assert {:halt, %{state: :halted}} = Halt.reading(released(), :open, 0)
    assert {:halt, %{state: :halted}} = Halt.edge(released())
  end

  test "it is released when it was closed for the whole time, and not before" do
    {:listen, d} = Halt.reading(halted(), :closed, 0)
    assert {:none, d} = Halt.reading(d, :closed, 99)
    assert {:release, %{state: :released}} = Halt.reading(d, :closed, 100)
  end

  test "the time starts again after an open contact or an edge" do
    {:listen, d} = Halt.reading(halted(), :closed, 0)
    {:none, opened} = Halt.reading(d, :open, 50)
    assert {:listen, _} = Halt.reading(opened, :closed, 100)
    {:wait, shaken} = Halt.edge(d)
    assert {:listen, d} = Halt.reading(shaken, :closed, 100)
    assert {:none, _} = Halt.reading(d, :closed, 150)
  end

  test "an edge each time that it may soon be released is noise, after twenty-five of them" do
    verdicts =
      Stream.unfold(halted(), fn d ->
        {:listen, d} = Halt.reading(d, :closed, 0)
        Halt.edge(d)
      end)

    assert Enum.find_index(verdicts, &(&1 == :noise)) == 24
  end

  test "twenty presses in a row are no noise" do
    Enum.reduce(1..20, halted(), fn _, d ->
      {:listen, d} = Halt.reading(d, :closed, 0)
      {:wait, d} = Halt.edge(d)
      {:none, d} = Halt.reading(d, :open, 0)
      d
    end)
  end
end

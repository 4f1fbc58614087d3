defmodule BB.Bus.Sim.GPIO.LineTest do
  use ExUnit.Case, async: true

  alias BB.Bus.Sim.GPIO.{Agenda, Handle, Line}

  doctest Line
  doctest Agenda
  doctest Handle

  defp input(pull), do: Line.host(%Line{}, :input, pull)

  test "a driver of 0 wins over a driver of 1" do
    line = input(:pullup) |> Line.drive(:a, 1) |> Line.drive(:b, 0)
    assert {line.near, line.far} == {0, 0}
  end

  test "a driver wins over a pull, and a resistor outside wins over the pin's pull" do
    assert (input(:pullup) |> Line.drive(:a, 0)).near == 0
    assert (input(:pullup) |> Line.drive(:a, :pulldown)).near == 0
    assert (input(:pulldown) |> Line.drive(:a, :pullup)).near == 1
  end

  test "without a driver it keeps its level" do
    line = input(:none) |> Line.drive(:a, 1) |> Line.drive(:a, :z)
    assert {line.near, line.far} == {1, 1}
  end

  test "an output drives its far end" do
    line = Line.host(%Line{}, {:output, 1}, :none)
    assert {line.near, line.far} == {1, 1}
  end

  test "an output that lets go leaves the line to its pull" do
    assert Line.host(%Line{}, {:output, :z}, :pullup).far == 1
  end

  test "when it is cut each end has its own level, until the fault is cleared" do
    line = input(:pullup) |> Line.drive(:a, 0) |> Line.fault(:cut)
    assert {line.near, line.far} == {1, 0}
    assert Line.drive(line, :a, 1).far == 1
    line = Line.fault(line, nil)
    assert {line.near, line.far} == {0, 0}
  end

  test "a short circuit decides at both ends" do
    line = input(:pullup) |> Line.drive(:a, 1) |> Line.fault({:short, 0})
    assert {line.near, line.far} == {0, 0}
  end

  test "noise inverts the level at the pin, at either level of the wire" do
    line = input(:pullup) |> Line.drive(:a, 0) |> Line.fault({:storm, 1000}) |> Line.disturb()
    assert {line.near, line.far} == {1, 0}
    assert Line.disturb(line).near == 0
    assert Line.fault(line, nil).near == 0
  end

  test "a term that is no fault raises with the expected ones" do
    assert_raise ArgumentError, ~r/expected a fault: :cut, .* got: :broken/, fn ->
      Line.check_fault!(:broken)
    end
  end
end

defmodule BB.Bus.GPIO.LineTest do
  use ExUnit.Case, async: true

  alias BB.Bus.GPIO.Line
  alias BB.Bus.Sim.{GPIO, Lines}

  doctest Line

  setup do
    chip = "gpiochip-line-#{System.unique_integer([:positive])}"
    start_supervised!({Lines, chips: %{chip => [lines: 8]}})
    %{chip: chip, spec: {chip, 1}}
  end

  defp open!(spec, direction \\ :input, opts \\ []) do
    {:ok, line} = Line.open(GPIO, spec, direction, opts)
    line
  end

  test "it is opened although another process has it, which then has lost it", %{spec: spec} do
    first = open!(spec, :output)
    second = open!(spec, :output)
    assert Line.read(first) == {:error, {:line_lost, spec}}
    assert Line.write(first, 1) == {:error, {:line_lost, spec}}
    assert Line.listen(first, :both) == {:error, {:line_lost, spec}}
    assert Line.write(second, 1) == :ok
    assert Line.read(second) == {:ok, 1}
    assert Line.close(first) == :ok
  end

  test "the error of a missing or busy line has the line's name", %{chip: chip} do
    assert Line.open(GPIO, {chip, 8}, :input, []) == {:error, {:line_not_found, {chip, 8}}}
    assert Line.open(GPIO, "LED", :input, []) == {:error, {:line_not_found, "LED"}}
    :ok = Lines.fault({chip, 1}, :busy)
    assert Line.open(GPIO, {chip, 1}, :input, []) == {:error, {:line_busy, {chip, 1}}}
    twice = [{chip, 2}, {chip, 2}]
    assert Line.open(GPIO, twice, :input, []) == {:error, {:line, twice, :duplicate_lines}}
  end

  test "edges arrive from the call on, and none is left over when it is closed", %{spec: spec} do
    line = open!(spec)
    :ok = Line.listen(line, :both)
    :ok = Lines.drive(spec, 1)
    :ok = Line.listen(line, :both)
    refute_received {:circuits_gpio, _, _, _}
    :ok = Lines.drive(spec, 0)
    :ok = Line.close(line)
    refute_received {:circuits_gpio, _, _, _}
  end

  test "it is quiet unless there is a storm", %{spec: spec} do
    line = open!(spec)
    assert Line.check_quiet(line) == :ok
    :ok = Lines.fault(spec, {:storm, 5_000})
    assert Line.check_quiet(line) == {:error, {:noise, spec}}
  end

  test "a line whose preparation fails is closed", %{spec: spec} do
    open = fn -> Line.open(GPIO, spec, :input, []) end
    assert Line.open_with(open, fn _line -> {:error, :deaf} end) == {:error, :deaf}
    assert {:ok, _handle} = GPIO.open(spec, :input)
  end

  test "a line is written as Circuits has it, and anything else refused with an example" do
    for spec <- [{"gpiochip0", 17}, {"gpiochip0", "GPIO17"}, "GPIO17", 17],
        do: assert(Line.check_spec(spec) == {:ok, spec})

    assert {:error, ~s(expected a line, such as {"gpiochip0", 17}) <> _} = Line.check_spec(:led)
    assert {:error, _} = Line.check_spec({"gpiochip0", -1})
  end
end

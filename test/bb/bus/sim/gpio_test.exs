defmodule BB.Bus.Sim.GPIOTest do
  use ExUnit.Case, async: true

  alias BB.Bus.Sim.{GPIO, Lines}

  doctest GPIO

  setup do
    chip = "gpiochip-gpio-#{System.unique_integer([:positive])}"
    options = [lines: 8, label: chip <> "-pins", labels: %{5 => chip <> "-led"}]
    start_supervised!({Lines, chips: %{chip => options}})
    %{chip: chip}
  end

  defp open!(chip, offset, direction, opts \\ []) do
    {:ok, line} = GPIO.open({chip, offset}, direction, opts)
    line
  end

  # Runs in a process that then ends, and waits until the chip has seen that.
  defp elsewhere(fun) do
    task = Task.async(fun)
    Task.await(task, :infinity)
  end

  describe "opening" do
    test "takes a number, a label, a chip's label and identifiers", %{chip: chip} do
      for spec <- [
            {chip, 5},
            chip <> "-led",
            {chip, chip <> "-led"},
            {chip <> "-pins", 5},
            %{location: {chip, 5}}
          ] do
        assert {:ok, line} = GPIO.open(spec, :input)
        assert GPIO.close(line) == :ok
      end

      led = %{location: {chip, 5}, controller: chip <> "-pins", label: chip <> "-led"}
      assert led in GPIO.enumerate()
    end

    test "of a missing chip, label or line is an error", %{chip: chip} do
      assert GPIO.open({"gpiochip-none", 1}, :input) == {:error, :not_found}
      assert GPIO.open("no such label", :input) == {:error, :not_found}
      assert GPIO.open({chip, "no such label"}, :input) == {:error, :not_found}
      assert GPIO.open({chip, 8}, :input) == {:error, :einval}
      assert GPIO.identifiers(-1) == {:error, :not_found}
      assert GPIO.identifiers({chip, 8}) == {:error, :not_found}
    end

    test "with wrong arguments raises", %{chip: chip} do
      assert_raise ArgumentError, ~r/Invalid GPIO spec/, fn -> GPIO.open(:led, :output) end
      assert_raise ArgumentError, fn -> GPIO.open({chip, 1}, :sideways) end
      assert_raise ArgumentError, fn -> GPIO.open({chip, 1}, :input, pull_mode: :up) end
      assert_raise ArgumentError, fn -> GPIO.open({chip, 1}, :input, on_busy: :wait) end
      assert_raise ArgumentError, fn -> GPIO.open({chip, 1}, :output, initial_value: -1) end
      assert_raise ArgumentError, fn -> GPIO.open([], :input) end
    end

    test "a line that is open is an error, unless it is taken over", %{chip: chip} do
      first = open!(chip, 1, :input)
      assert GPIO.open({chip, 1}, :input) == {:error, :already_open}
      second = open!(chip, 1, :input, on_busy: :take_over)
      assert_raise ErlangError, ~r/:ebadf/, fn -> GPIO.read(first) end
      assert GPIO.read(second) == 0
      assert GPIO.close(first) == :ok
      assert GPIO.read(second) == 0
    end

    test "a line that another program has is an error, even if it is to be taken over", %{
      chip: chip
    } do
      :ok = Lines.fault({chip, 1}, :busy)
      assert GPIO.open({chip, 1}, :input, on_busy: :take_over) == {:error, :already_open}
      :ok = Lines.clear({chip, 1})
      assert {:ok, _line} = GPIO.open({chip, 1}, :input)
    end

    test "closes with the process that did it, and with force_close/1", %{chip: chip} do
      elsewhere(fn -> open!(chip, 1, :input) end)
      line = open!(chip, 1, :input, on_busy: :take_over)
      assert GPIO.force_close({chip, 1}) == :ok
      assert_raise ErlangError, fn -> GPIO.read(line) end
      assert {:ok, _line} = GPIO.open({chip, 1}, :input)
      assert GPIO.force_close("no such label") == {:error, :not_found}
    end
  end

  describe "levels" do
    test "an output drives, an input reads", %{chip: chip} do
      out = open!(chip, 1, :output, initial_value: 1)
      assert Lines.level({chip, 1}) == 1
      assert GPIO.write(out, 0) == :ok
      assert Lines.level({chip, 1}) == 0
      assert GPIO.read(out) == 0

      assert_raise ErlangError, ~r/:pin_not_output/, fn ->
        GPIO.write(open!(chip, 2, :input), 1)
      end
    end

    test "a pull decides the level without a driver, until it is changed", %{chip: chip} do
      line = open!(chip, 1, :input, pull_mode: :pullup)
      assert GPIO.read(line) == 1
      assert GPIO.set_pull_mode(line, :pulldown) == :ok
      assert GPIO.read(line) == 0
      GPIO.close(line)
      assert GPIO.read(open!(chip, 1, :input)) == 0
    end

    test "an open drain lets go at 1, an open source at 0", %{chip: chip} do
      drain = open!(chip, 1, :output, drive_mode: :open_drain, initial_value: 1)
      :ok = Lines.drive({chip, 1}, :pulldown)
      assert Lines.level({chip, 1}) == 0
      :ok = GPIO.set_drive_mode(drain, :open_source)
      assert Lines.level({chip, 1}) == 1
      :ok = GPIO.write(drain, 0)
      :ok = Lines.drive({chip, 1}, :pullup)
      assert Lines.level({chip, 1}) == 1
    end

    test "an input becomes an output and back", %{chip: chip} do
      line = open!(chip, 1, :input, pull_mode: :pullup)
      assert GPIO.set_direction(line, :output) == :ok
      assert Lines.level({chip, 1}) == 0
      assert GPIO.set_direction(line, :input) == :ok
      assert Lines.level({chip, 1}) == 1
    end

    test "a group is read and written at once, the first line lowest", %{chip: chip} do
      {:ok, outs} = GPIO.open([{chip, 1}, {chip, 3}], :output, initial_value: 0b10)
      assert {Lines.level({chip, 1}), Lines.level({chip, 3})} == {0, 1}
      assert GPIO.write(outs, 0b01) == :ok
      assert {Lines.level({chip, 1}), Lines.level({chip, 3})} == {1, 0}
      assert GPIO.read(outs) == 0b01
      assert GPIO.open([{chip, 3}, {chip, 4}], :input) == {:error, :already_open}
      assert GPIO.open([{chip, 4}, {chip, 4}], :input) == {:error, :duplicate_lines}
      assert GPIO.set_interrupts(outs, :both) == {:error, :group_handle}
      assert GPIO.status(outs) == {:error, :group_handle}
    end

    test "read_one/2 and write_one/3 open and close", %{chip: chip} do
      assert GPIO.read_one({chip, 1}, pull_mode: :pullup) == 1
      assert GPIO.write_one({chip, 1}, 0) == :ok
      assert {:ok, %{consumer: ""}} = GPIO.status({chip, 1})
    end
  end

  describe "edges" do
    test "arrive with the spec of open/3, as the trigger selects", %{chip: chip} do
      {:ok, line} = GPIO.open(chip <> "-led", :input, pull_mode: :pullup)
      spec = chip <> "-led"
      assert GPIO.set_interrupts(line, :both) == :ok
      :ok = Lines.drive({chip, 5}, 0)
      assert_received {:circuits_gpio, ^spec, first_ns, 0}
      :ok = Lines.drive({chip, 5}, :z)
      assert_received {:circuits_gpio, ^spec, second_ns, 1}
      assert second_ns >= first_ns

      assert GPIO.set_interrupts(line, :falling) == :ok
      for level <- [0, 1, 1, 0], do: :ok = Lines.drive({chip, 5}, level)
      assert_received {:circuits_gpio, ^spec, _, 0}
      assert_received {:circuits_gpio, ^spec, _, 0}
      refute_received {:circuits_gpio, _, _, _}

      assert GPIO.set_interrupts(line, :none) == :ok
      :ok = Lines.drive({chip, 5}, 1)
      refute_received {:circuits_gpio, _, _, _}
    end

    test "arrive at a subscriber with the value before", %{chip: chip} do
      {:ok, group} = GPIO.open([{chip, 1}, {chip, 2}], :input)
      assert {:ok, ref} = GPIO.subscribe(group)
      :ok = Lines.drive({chip, 2}, 1)
      :ok = Lines.drive({chip, 1}, 1)
      assert_received {:circuits_gpio, %{ref: ^ref, value: 0b10, previous_value: 0b00}}
      assert_received {:circuits_gpio, %{ref: ^ref, value: 0b11, previous_value: 0b10}}
      assert GPIO.unsubscribe(group) == :ok
      :ok = Lines.drive({chip, 1}, 0)
      refute_received {:circuits_gpio, _}
      assert {:ok, :tagged} = GPIO.subscribe(group, tag: :tagged, trigger: :rising)
      :ok = Lines.drive({chip, 1}, 1)
      assert_received {:circuits_gpio, %{ref: :tagged, value: 0b11}}
    end

    test "end with the handle and are errors without one", %{chip: chip} do
      line = open!(chip, 1, :input)
      :ok = GPIO.set_interrupts(line, :both)
      :ok = GPIO.close(line)
      :ok = Lines.drive({chip, 1}, 1)
      refute_received {:circuits_gpio, _, _, _}
      assert GPIO.set_interrupts(line, :both) == {:error, :ebadf}
      assert GPIO.subscribe(line) == {:error, :ebadf}
      assert GPIO.set_interrupts(open!(chip, 1, :output), :both) == {:error, :einval}
    end
  end

  test "a line of a chip that is gone is the kernel's ENODEV", %{chip: chip} do
    line = open!(chip, 1, :input)
    stop_supervised!({Lines, [chip]})
    assert_raise ErlangError, ~r/:enodev/, fn -> GPIO.read(line) end
    assert GPIO.set_interrupts(line, :both) == {:error, :enodev}
    assert GPIO.close(line) == :ok
    assert GPIO.open({chip, 1}, :input) == {:error, :not_found}
  end

  test "status/1 returns the settings of a line, and whether it is open", %{chip: chip} do
    line = open!(chip, 1, :input, pull_mode: :pullup)

    expected =
      {:ok,
       %{
         consumer: "circuits_gpio",
         direction: :input,
         pull_mode: :pullup,
         drive_mode: :push_pull
       }}

    assert GPIO.status(line) == expected
    assert GPIO.status({chip, 1}) == expected
    assert {:ok, %{consumer: ""}} = GPIO.status({chip, 2})
    assert GPIO.status({chip, 8}) == {:error, :einval}
  end
end

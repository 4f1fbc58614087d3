defmodule BB.Bus.Linux.GPIOTest do
  use ExUnit.Case, async: false

  import BB.Test.Linux

  alias BB.Bus.GPIO.Line
  alias BB.Bus.Linux.GPIO

  @moduletag :tmp_dir
  setup :use_folder

  @line %GPIO{ref: nil, spec: {"gpiochip0", 1}, locations: [{"gpiochip0", 1}]}
  @group %GPIO{ref: nil, spec: [], locations: [{"gpiochip0", 1}, {"gpiochip0", 2}]}

  test "has the functions of Circuits 2.3, each with its arities" do
    assert_functions(GPIO,
      open: [2, 3],
      close: [1],
      force_close: [1],
      read: [1],
      read_one: [1, 2],
      write: [2],
      write_one: [2, 3],
      set_interrupts: [2, 3],
      subscribe: [1, 2],
      unsubscribe: [1],
      set_direction: [2],
      set_pull_mode: [2],
      set_drive_mode: [2],
      enumerate: [0, 1],
      identifiers: [1],
      status: [1],
      gpio_spec?: [1],
      backend_info: [0, 1]
    )

    assert macro_exported?(GPIO, :is_gpio_spec, 1)
  end

  test "wrong arguments raise with Circuits' messages" do
    for {words, fun} <- [
          {~r/Invalid GPIO spec: :led/, fn -> GPIO.open(:led, :input) end},
          {~r/Invalid direction: :up/, fn -> GPIO.open({"gpiochip0", 1}, :up) end},
          {~r/non-empty list/, fn -> GPIO.open([], :input) end},
          {~r/limited to 64/, fn -> GPIO.open(List.duplicate(1, 65), :input) end},
          {~r/:pull_mode should be/, fn -> GPIO.open(1, :input, pull_mode: :up) end},
          {~r/:drive_mode should be/, fn -> GPIO.open(1, :input, drive_mode: :hard) end},
          {~r/:on_busy should be/, fn -> GPIO.open(1, :input, on_busy: :wait) end},
          {~r/:initial_value should be/, fn -> GPIO.open(1, :output, initial_value: -1) end},
          {~r/value of 0 or 1.*got: :high/, fn -> GPIO.write(@line, :high) end},
          {~r/trigger.*got: :edge/, fn -> GPIO.set_interrupts(@line, :edge) end},
          {~r/trigger.*got: :edge/, fn -> GPIO.subscribe(@line, trigger: :edge) end},
          {~r/Invalid direction/, fn -> GPIO.set_direction(@line, :up) end},
          {~r/pull mode.*got: :up/, fn -> GPIO.set_pull_mode(@line, :up) end},
          {~r/drive mode.*got: :hard/, fn -> GPIO.set_drive_mode(@line, :hard) end},
          {~r/Invalid GPIO spec/, fn -> GPIO.force_close([:led]) end}
        ],
        do: assert_raise(ArgumentError, words, fun)
  end

  test "a group has neither one status nor interrupts" do
    assert GPIO.set_interrupts(@group, :both) == {:error, :group_handle}
    assert GPIO.status(@group) == {:error, :group_handle}
  end

  test "a missing line is an error for every kind of spec" do
    for spec <- [
          {"gpiochip0", 1},
          {"gpiochip/../null", 1},
          {"pins", 1},
          {"pins", "LED"},
          "LED",
          0,
          -1
        ] do
      assert GPIO.open(spec, :input) == {:error, :not_found}
      assert GPIO.status(spec) == {:error, :not_found}
      assert GPIO.force_close(spec) == {:error, :not_found}
      assert GPIO.read_one(spec) == {:error, :not_found}
      assert GPIO.write_one(spec, 1) == {:error, :not_found}
    end

    assert GPIO.enumerate() == []
    assert GPIO.identifiers("LED") == {:error, :not_found}
  end

  test "an invalid group is refused before any line is opened" do
    assert GPIO.open([{"gpiochip0", 1}, {"gpiochip1", 1}], :input) ==
             {:error, :multiple_controllers}

    assert GPIO.open([{"gpiochip0", 1}, {"gpiochip0", 1}], :input) == {:error, :duplicate_lines}
  end

  test "a file that is no chip is refused", %{tmp_dir: folder} do
    for {name, kind} <- strangers(folder, "gpiochip") do
      assert {kind, GPIO.open({name, 1}, :input)} == {kind, {:error, :enotty}}
      assert {kind, GPIO.status({name, 1})} == {kind, {:error, :enotty}}
    end

    assert GPIO.enumerate() == []
  end

  test "missing rights are an error, also for a label on a chip without rights", %{
    tmp_dir: folder
  } do
    path = Path.join(folder, "gpiochip0")
    File.write!(path, "")

    for {spec, code} <- [{{"gpiochip0", 1}, ~s({"gpiochip0", 1})}, {"LED", ~s("LED")}] do
      assert without_rights(
               path,
               fn -> GPIO.open(spec, :input) end,
               "BB.Bus.Linux.GPIO.open(#{code}, :input)"
             ) == {:error, :eacces}
    end

    defmodule Locked do
      def open(_spec, _direction, _opts), do: {:error, :eacces}
    end

    assert {:error, {:no_rights, "LED"} = reason} = Line.open(Locked, "LED", :input, [])
    assert Line.explain(reason) =~ "line LED: no rights on #{path}"
    assert Line.explain({:no_rights, {"gpiochip0", 1}}) =~ "no rights on #{path}"
  end

  test "a thousand refused openings leave no descriptor and no thread", %{tmp_dir: folder} do
    File.write!(Path.join(folder, "gpiochip0"), "")
    open = fn -> {:error, :enotty} = GPIO.open({"gpiochip0", 1}, :input) end
    open.()
    assert_nothing_left(fn -> for _ <- 1..1000, do: open.() end)
  end
end

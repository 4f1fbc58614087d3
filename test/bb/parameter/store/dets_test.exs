defmodule BB.Parameter.Store.DetsTest do
  use ExUnit.Case, async: true

  import BB.Test.Robot
  import BB.Unit, only: :sigils
  import ExUnit.CaptureLog

  alias BB.Parameter
  alias BB.Parameter.Store.Dets

  @moduletag :tmp_dir

  setup %{tmp_dir: dir} do
    file = Path.join([dir, "kept", "params"])

    robot =
      create(
        quote do
          settings parameter_store: {BB.Parameter.Store.Dets, path: unquote(file)}

          parameters do
            param :gain, type: :float, default: 1.0
            param :rate, type: {:unit, :hertz}, default: ~u(1 hertz)
          end
        end
      )

    %{robot: robot, stored: file}
  end

  test "keeps values from one start of the robot to the next, in folders that it makes", %{
    robot: robot
  } do
    start_supervised!(robot)
    :ok = Parameter.set_many(robot, [{[:gain], 2.0}, {[:rate], ~u(1 kilohertz)}])
    stop_supervised!(robot)
    start_supervised!(robot)
    assert Parameter.get!(robot, [:gain]) == 2.0
    assert Parameter.get!(robot, [:rate]) == ~u(1000 hertz)
  end

  test "has a value on the disk when set returns: it is there after a kill", %{robot: robot} do
    start_supervised!(robot)
    :ok = Parameter.set(robot, [:gain], 2.0)
    writer = Process.whereis(Module.concat(robot, ParameterOwner))
    ref = Process.monitor(writer)
    Process.exit(writer, :kill)
    assert_receive {:DOWN, ^ref, _, _, _}
    stop_supervised!(robot)
    start_supervised!(robot)
    assert Parameter.get!(robot, [:gain]) == 2.0
  end

  test "a file that was not closed is repaired", %{robot: robot, stored: file} do
    start_supervised!(robot)
    :ok = Parameter.set(robot, [:gain], 2.0)
    as_the_power_fails = File.read!(file)
    stop_supervised!(robot)
    File.write!(file, as_the_power_fails)
    start_supervised!(robot)
    assert Parameter.get!(robot, [:gain]) == 2.0
  end

  for {what, content} <- [
        {"garbage", String.duplicate("garbage", 1_000)},
        {"empty", ""},
        {"one byte", <<0>>}
      ] do
    test "a corrupt file (#{what}) is renamed and logged, and never stops the boot", %{
      robot: robot,
      stored: file
    } do
      File.mkdir_p!(Path.dirname(file))
      File.write!(file, unquote(content))
      log = capture_log(fn -> start_supervised!(robot) end)
      assert log =~ "the parameter store #{file} cannot be read"
      assert log =~ "it is now #{file}.corrupt"
      assert File.read!(file <> ".corrupt") == unquote(content)
      :ok = Parameter.set(robot, [:gain], 2.0)
      stop_supervised!(robot)
      start_supervised!(robot)
      assert Parameter.get!(robot, [:gain]) == 2.0
    end
  end

  test "a file that is damaged anywhere never stops the boot", %{robot: robot, stored: file} do
    start_supervised!(robot)
    for n <- 1..20, do: :ok = Parameter.set(robot, [:gain], n / 1)
    stop_supervised!(robot)
    whole = File.read!(file)

    # :dets itself writes a line about each repair to the terminal.
    for at <- 0..(byte_size(whole) - 1)//1201 do
      <<head::binary-size(at), byte, tail::binary>> = whole
      File.write!(file, [head, Bitwise.bxor(byte, 0xFF), tail])
      capture_log(fn -> start_supervised!(robot) end)
      assert is_float(Parameter.get!(robot, [:gain]))
      stop_supervised!(robot)
      File.write!(file, binary_part(whole, 0, at))
      capture_log(fn -> start_supervised!(robot) end)
      assert is_float(Parameter.get!(robot, [:gain]))
      stop_supervised!(robot)
    end
  end

  test "a place where no file can be made costs a warning, and the robot runs", %{
    robot: robot,
    stored: file
  } do
    File.mkdir_p!(file)
    log = capture_log(fn -> start_supervised!(robot) end)
    assert log =~ "cannot open the parameter store BB.Parameter.Store.Dets"
    assert Parameter.set(robot, [:gain], 2.0) == :ok
  end

  test "needs a path" do
    assert {:error, %BB.Options.ValidationError{} = error} = Dets.init(SomeRobot, [])
    assert Exception.message(error) =~ "required :path option not found"
  end
end

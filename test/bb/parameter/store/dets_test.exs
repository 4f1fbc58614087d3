defmodule BB.Parameter.Store.DetsTest do
  use ExUnit.Case, async: true

  import BB.Test.Robot
  import BB.Test.SmallDisk
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
      assert log =~ "the parameter store #{file} cannot be read as a whole; "
      assert log =~ "the number of lost values is unknown; the file is renamed to #{file}.corrupt"
      assert [%{file: ^file, lost: :unknown}] = damages(robot)
      assert File.read!(file <> ".corrupt") == unquote(content)
      :ok = Parameter.set(robot, [:gain], 2.0)
      stop_supervised!(robot)
      start_supervised!(robot)
      assert Parameter.get!(robot, [:gain]) == 2.0
    end
  end

  defp damages(robot) do
    for {{Parameter, ^robot, :damaged}, damage} <- :alarm_handler.get_alarms(), do: damage
  end

  test "a file from which values are missing is kept, and they are counted", %{
    robot: robot,
    stored: file
  } do
    start_supervised!(robot)
    :ok = Parameter.set_many(robot, [{[:gain], 2.0}, {[:rate], ~u(2 hertz)}])
    stop_supervised!(robot)
    cut = binary_part(File.read!(file), 0, 3_000)
    File.write!(file, cut)
    log = capture_log(fn -> start_supervised!(robot) end)

    assert log =~
             "cannot be read as a whole; the number of lost values is unknown; the file is renamed to "

    assert [%{lost: :unknown, kept_as: kept_as}] = damages(robot)
    assert File.read!(kept_as) == cut
    assert Path.wildcard(file <> ".import") == []
  end

  test "a file that is damaged anywhere never stops the boot", %{robot: robot, stored: file} do
    start_supervised!(robot)
    for n <- 1..20, do: :ok = Parameter.set(robot, [:gain], n / 1)
    stop_supervised!(robot)
    whole = File.read!(file)

    # :dets itself writes a line about each repair to the terminal.
    for at <- 0..(byte_size(whole) - 1)//1201 do
      tail = binary_part(whole, at + 1, byte_size(whole) - at - 1)
      flipped = Bitwise.bxor(:binary.at(whole, at), 0xFF)
      File.write!(file, [binary_part(whole, 0, at), flipped, tail])
      capture_log(fn -> start_supervised!(robot) end)
      assert is_float(Parameter.get!(robot, [:gain]))
      stop_supervised!(robot)
      File.write!(file, binary_part(whole, 0, at))
      capture_log(fn -> start_supervised!(robot) end)
      assert is_float(Parameter.get!(robot, [:gain]))
      stop_supervised!(robot)
    end
  end

  test "a set_many of which a kill left a part is whole when the file is opened", %{stored: file} do
    File.mkdir_p!(Path.dirname(file))
    {:ok, table} = :dets.open_file(make_ref(), file: to_charlist(file), type: :set)
    rows = [{[:a], 1}, {[:b], 1}, {[:c], 1}]
    # First the change as one row; then a kill came after the first of its values.
    :ok = :dets.insert(table, rows ++ [{:latest, [{[:a], 2}, {[:b], 2}]}, {[:a], 2}])
    :ok = :dets.close(table)
    {:ok, store} = Dets.init(SomeRobot, path: file)
    assert {:ok, [{[:a], 2}, {[:b], 2}, {[:c], 1}]} = Dets.load(store)
    assert Dets.save(store, [:b], 3) == :ok
    assert {:ok, [{[:a], 2}, {[:b], 3}, {[:c], 1}]} = Dets.load(store)
    :ok = Dets.close(store)
  end

  test "a disk that is full is used again when there is room" do
    with {:ok, folder} <- mount(128) do
      {:ok, store} = Dets.init(SomeRobot, path: Path.join(folder, "params"))
      :ok = Dets.save(store, [:a], 1)
      fill(folder)

      assert Dets.save(store, [:b], String.duplicate("b", 20_000)) ==
               {:error, {:dets_write_failed, :enospc}}

      assert {:error, {:dets_write_failed, _}} =
               Dets.save(store, [:b], String.duplicate("b", 20_000))

      free(folder)
      assert Dets.save(store, [:b], 2) == :ok
      assert {:ok, [{[:a], 1}, {[:b], 2}]} = Dets.load(store)
      :ok = Dets.close(store)
    end
  end

  test "a place where no file can be made costs a warning, and the robot runs", %{
    robot: robot,
    stored: file
  } do
    File.mkdir_p!(file)
    log = capture_log(fn -> start_supervised!(robot) end)
    assert log =~ "cannot open the parameter store BB.Parameter.Store.Dets: illegal operation on"

    assert Parameter.set(robot, [:gain], 2.0) ==
             {:error, {:not_kept, {:dets_open_failed, :eisdir}}}

    assert Parameter.get(robot, [:gain]) == {:ok, 2.0}
  end

  test "needs a path" do
    assert Dets.init(SomeRobot, []) == {:error, {:missing_option, :path}}
    assert Dets.init(SomeRobot, auto_save: 1000) == {:error, {:missing_option, :path}}
    assert {:error, %BB.Options.ValidationError{key: :path}} = Dets.init(SomeRobot, path: 1)
    assert {:error, %BB.Options.ValidationError{}} = Dets.init(SomeRobot, path: "x", pth: "y")

    robot = create(quote(do: settings(parameter_store: BB.Parameter.Store.Dets)))
    log = capture_log(fn -> start_supervised!(robot) end)
    assert log =~ "cannot open the parameter store BB.Parameter.Store.Dets: required :path option"
  end

  test "has its table and path in the state, and the file on the disk, once it is open", %{
    stored: file
  } do
    assert {:ok, %{table: table, path: ^file} = store} =
             Dets.init(SomeRobot, path: file, auto_save: 1)

    assert File.regular?(file)
    assert :dets.info(table, :filename) == to_charlist(file)
    assert Dets.load(store) == {:ok, []}
    assert Dets.save(store, [:a, :b], 1) == :ok
    assert Dets.save(store, [:a, :b], 2) == :ok
    assert Dets.load(store) == {:ok, [{[:a, :b], 2}]}
    assert Dets.close(store) == :ok
  end

  test "reads the rows of Beam Bots, which a row of ours replaces", %{stored: file} do
    File.mkdir_p!(Path.dirname(file))
    {:ok, table} = :dets.open_file(make_ref(), file: to_charlist(file), type: :set)
    :ok = :dets.insert(table, [{{:param, [:gain]}, 3.0}, {{:param, [:old]}, 1}, {[:old], 2}])
    :ok = :dets.close(table)
    {:ok, store} = Dets.init(SomeRobot, path: file)
    {:ok, values} = Dets.load(store)
    assert Enum.sort(values) == [{[:gain], 3.0}, {[:old], 2}]
    assert Dets.save(store, [:gain], 4.0) == :ok
    {:ok, values} = Dets.load(store)
    assert Enum.sort(values) == [{[:gain], 4.0}, {[:old], 2}]
    :ok = Dets.close(store)
  end

  test "starts a robot with the values of Beam Bots", %{robot: robot, stored: file} do
    File.mkdir_p!(Path.dirname(file))
    {:ok, table} = :dets.open_file(make_ref(), file: to_charlist(file), type: :set)
    :ok = :dets.insert(table, {{:param, [:gain]}, 3.0})
    :ok = :dets.close(table)
    start_supervised!(robot)
    assert Parameter.get(robot, [:gain]) == {:ok, 3.0}
  end
end

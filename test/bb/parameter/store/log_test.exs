defmodule BB.Parameter.Store.LogTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Robot
  import BB.Test.SmallDisk
  import BB.Unit, only: :sigils
  import ExUnit.CaptureLog

  alias BB.Parameter
  alias BB.Parameter.Store.{Dets, Log}
  alias BB.Parameter.Store.Log.{Entry, Format}

  @moduletag :tmp_dir
  @moduletag timeout: 300_000

  setup %{tmp_dir: folder} do
    file = Path.join([folder, "kept", "params"])
    %{stored: file, robot: robot_with(file)}
  end

  defp robot_with(file, store \\ Log) do
    create(
      quote do
        settings parameter_store: {unquote(store), path: unquote(file)}

        parameters do
          param :gain, type: :float, default: 1.0
          param :rate, type: {:unit, :hertz}, default: ~u(1 hertz)
          param :note, type: :string, default: ""
          param :mode, type: :atom, default: :calm
        end
      end
    )
  end

  # The store without a robot

  defp open!(file) do
    {:ok, store} = Log.init(SomeRobot, path: file)
    store
  end

  defp loaded(store) do
    {:ok, pairs} = Log.load(store)
    Map.new(pairs)
  end

  defp kept(file) do
    store = open!(file)
    values = loaded(store)
    :ok = Log.close(store)
    values
  end

  defp keep(file, sets) do
    store = open!(file)
    for values <- sets, do: :ok = Log.save_many(store, Map.to_list(values))
    :ok = Log.close(store)
  end

  defp alarm(robot, which) do
    for {{Parameter, ^robot, ^which}, about} <- :alarm_handler.get_alarms(), do: about
  end

  describe "the callbacks" do
    test "make a file with init, keep values, replace them, and close", %{stored: file} do
      store = open!(file)
      assert File.regular?(file)
      assert loaded(store) == %{}
      assert Log.save(store, [:gain], 2.0) == :ok
      assert Log.save(store, [:gain], 3.0) == :ok
      assert Log.save_many(store, [{[:imu, :rate], ~u(5 hertz)}, {[:on], true}]) == :ok
      assert Log.save_many(store, []) == :ok
      values = %{[:gain] => 3.0, [:imu, :rate] => ~u(5 hertz), [:on] => true}
      assert loaded(store) == values
      assert Log.damage(store) == nil
      assert Log.close(store) == :ok
      assert kept(file) == values
    end

    test "need a path" do
      assert {:error, %BB.Options.ValidationError{} = error} = Log.init(SomeRobot, [])
      assert Exception.message(error) =~ "required :path option not found"
    end

    test "keep ten thousand sets in a file that stays small", %{stored: file} do
      store = open!(file)
      for n <- 1..10_000, do: :ok = Log.save(store, [:"p#{rem(n, 7)}"], n)
      assert File.stat!(file).size == 4_096
      assert map_size(loaded(store)) == 7
      assert loaded(store)[[:p0]] == 9_996
    end

    test "keep values that are larger than the file was", %{stored: file} do
      large = for n <- 1..20, into: %{}, do: {[:"p#{n}"], :crypto.strong_rand_bytes(n * 1_000)}
      keep(file, [%{[:small] => 1}, large, %{[:small] => 2}])
      assert kept(file) == Map.put(large, [:small], 2)
      assert {:error, :efbig} = Log.save(open!(file), [:p], :binary.copy("x", 12_000_000))
      assert kept(file) == Map.put(large, [:small], 2)
    end

    test "follow a symbolic link", %{tmp_dir: folder} do
      [target, link] = for name <- ~w(target link), do: Path.join(folder, name)
      File.ln_s!("target", link)
      keep(link, [%{[:gain] => 1.0}])
      keep(link, [%{[:gain] => 2.0}])
      assert File.read_link!(link) == "target"
      assert kept(target) == %{[:gain] => 2.0}
    end
  end

  describe "a robot" do
    test "has its values when it is started again, in folders that the store makes", context do
      %{robot: robot} = context
      start_supervised!(robot)
      :ok = Parameter.set_many(robot, [{[:gain], 2.0}, {[:rate], ~u(1 kilohertz)}])
      stop_supervised!(robot)
      start_supervised!(robot)
      assert Parameter.get!(robot, [:gain]) == 2.0
      assert Parameter.get!(robot, [:rate]) == ~u(1000 hertz)
    end

    test "has a value on the disk when set returns", %{robot: robot, stored: file} do
      start_supervised!(robot)
      :ok = Parameter.set(robot, [:gain], 2.0)
      as_the_power_fails = File.read!(file)
      stop_supervised!(robot)
      File.write!(file, as_the_power_fails)
      start_supervised!(robot)
      assert Parameter.get!(robot, [:gain]) == 2.0
      assert alarm(robot, :damaged) == []
    end

    test "brings the values of a set_many to the disk by one sync", %{stored: file} do
      params = for n <- 1..50, do: quote(do: param(unquote(:"p#{n}"), type: :integer))

      robot =
        create(
          quote do
            settings parameter_store: {BB.Parameter.Store.Log, path: unquote(file)}
            parameters(do: unquote({:__block__, [], params}))
          end
        )

      start_supervised!(robot)
      persistence = Process.whereis(Module.concat(robot, ParameterPersistence))
      {:links, links} = Process.info(persistence, :links)
      syncs = [{:file, :datasync, 1}, {:file, :sync, 1}]
      for call <- syncs, do: :erlang.trace_pattern(call, true, [])
      for pid <- links, is_pid(pid), do: :erlang.trace(pid, true, [:call])
      :ok = Parameter.set_many(robot, for(n <- 1..50, do: {[:"p#{n}"], n}))
      :ok = Parameter.set_many(robot, for(n <- 1..50, do: {[:"p#{n}"], -n}))
      stop_supervised!(robot)

      assert_received {:trace, _, :call, {:file, :datasync, _}}
      assert_received {:trace, _, :call, {:file, :datasync, _}}
      refute_received {:trace, _, :call, _}
    end
  end

  test "a file that is copied at any instant has all of a set_many or none", %{stored: file} do
    store = open!(file)
    copier = Task.async(fn -> for n <- 1..500, do: copy(file, "#{file}.copy#{n}") end)
    writes = write_until_done(copier, store, 1)
    assert writes > 100

    for copy <- Task.await(copier, :infinity) do
      values = kept(copy)
      assert values[[:a]] == values[[:b]]
      assert is_nil(values[[:a]]) or byte_size(values[[:pad]]) == rem(values[[:a]], 700)
    end
  end

  defp copy(file, copy) do
    Process.sleep(1)
    {:ok, _} = File.copy(file, copy)
    copy
  end

  defp write_until_done(copier, store, n) do
    pad = :binary.copy("p", rem(n, 700))
    :ok = Log.save_many(store, [{[:a], n}, {[:pad], pad}, {[:b], n}])
    if Process.alive?(copier.pid), do: write_until_done(copier, store, n + 1), else: n
  end

  describe "a damaged file" do
    # Two starts: what the first set is the generation before of what the second did.
    @first [%{[:a] => 1, [:b] => 1}, %{[:c] => "one"}]
    @second [%{[:a] => 2, [:b] => 2}, %{[:d] => :two}, %{[:c] => "three"}]
    @before %{[:a] => 1, [:b] => 1, [:c] => "one"}
    @all %{[:a] => 2, [:b] => 2, [:c] => "three", [:d] => :two}

    # In memory, where a sync costs nothing.
    setup do
      folder = Path.join("/dev/shm", "log_test_#{System.os_time()}_#{:rand.uniform(9999)}")
      File.mkdir_p!(folder)
      on_exit(fn -> File.rm_rf!(folder) end)
      whole = Path.join(folder, "whole")
      keep(whole, @first)
      keep(whole, @second)
      %{folder: folder, whole: File.read!(whole), previous: File.read!(whole <> ".previous")}
    end

    defp damage(file, bytes, previous) do
      for leftover <- Path.wildcard(file <> "*"), do: File.rm!(leftover)
      File.write!(file, bytes)
      if previous, do: File.write!(file <> ".previous", previous)
      store = open!(file)
      {loaded(store), Log.damage(store), store}
    end

    # All that is written, and some of the filling behind it. FormatTest goes through these too.
    defp places(whole) do
      {:ok, %{end_at: used}} = Format.read(whole)
      last = byte_size(whole) - 1
      Enum.concat([0..(used + 1), (used + 2)..(last - 1)//257, [last]])
    end

    # Each value was set at some time; if not all are the newest, it is said, and how many.
    defp assert_honest(values, damage, before) do
      stale = Enum.count(@all, fn {path, value} -> values[path] != value end)

      for {path, value} <- values,
          do: assert(value in [@all[path], @before[path]])

      if before, do: assert(Map.keys(@before) -- Map.keys(values) == [])
      if stale > 0, do: assert(damage.lost == :unknown or damage.lost >= stale)
    end

    test "that was cut at any byte is kept, and used as far as it goes",
         %{folder: folder, whole: whole, previous: previous} do
      file = Path.join(folder, "cut")

      capture_log(fn ->
        for size <- places(whole), before <- [nil, previous] do
          cut = binary_part(whole, 0, size)
          {values, damage, store} = damage(file, cut, before)
          assert_honest(values, damage, before)
          assert %{file: ^file, kept_as: kept_as} = damage
          assert kept_as == file <> ".corrupt"
          assert File.read!(kept_as) == cut
          if before, do: assert(File.read!(file <> ".previous") == before)
          :ok = Log.save(store, [:e], 5)
          assert kept(file) == Map.put(values, [:e], 5)
        end
      end)
    end

    test "in which any byte is wrong is kept, and used as far as it can be read",
         %{folder: folder, whole: whole, previous: previous} do
      file = Path.join(folder, "flipped")

      capture_log(fn ->
        for at <- places(whole), before <- [nil, previous] do
          byte = Bitwise.bxor(:binary.at(whole, at), 0x41)
          flipped = put(whole, at, <<byte>>)
          {values, damage, store} = damage(file, flipped, before)
          assert_honest(values, damage, before)
          if damage, do: assert(File.read!(damage.kept_as) == flipped)
          :ok = Log.save(store, [:e], 5)
          assert kept(file) == Map.put(values, [:e], 5)
        end
      end)
    end

    defp put(bytes, at, new) do
      after_it = at + byte_size(new)
      tail = binary_part(bytes, after_it, byte_size(bytes) - after_it)
      binary_part(bytes, 0, at) <> new <> tail
    end

    test "of the generation before is no hindrance", %{folder: folder, whole: whole} do
      for previous <- ["", "garbage", binary_part(whole, 0, 100)] do
        assert {@all, nil, _store} = damage(Path.join(folder, "x"), whole, previous)
      end
    end

    test "is told with what is lost by the log, which names the file that was kept",
         %{folder: folder, whole: whole} do
      file = Path.join(folder, "told")
      {at, _} = :binary.match(whole, "three")
      log = capture_log(fn -> damage(file, put(whole, at, "T"), nil) end)

      assert log =~
               "SomeRobot: the parameter store #{file} cannot be read as a whole; 1 value is "

      assert log =~ "lost; the file is renamed to #{file}.corrupt, and a new one begins"
      log = capture_log(fn -> damage(file, binary_part(whole, 0, 150), nil) end)
      assert log =~ "the number of lost values is unknown"
    end

    test "of which only the base is damaged has lost nothing with the generation before",
         %{folder: folder, whole: whole, previous: previous} do
      {at, _} = :binary.match(whole, "one")
      damaged = put(whole, at, "O")

      capture_log(fn ->
        assert {@all, %{lost: 0}, _} = damage(Path.join(folder, "base"), damaged, previous)
        assert {@all, %{lost: 1}, _} = damage(Path.join(folder, "base"), damaged, nil)
      end)
    end

    test "that is missing gives way to the generation before", %{folder: folder, whole: whole} do
      file = Path.join(folder, "missing")
      File.write!(file <> ".previous", whole)
      log = capture_log(fn -> assert kept(file) == @all end)
      assert log =~ "#{file} is missing; the previous generation is used"
      assert kept(file) == @all
    end

    test "is kept beside those before it, of which there are nine at most", %{folder: folder} do
      file = Path.join(folder, "often")

      capture_log(fn ->
        for n <- 1..12 do
          File.write!(file, "garbage #{n}")
          kept(file)
        end
      end)

      names = ["corrupt" | for(n <- 2..9, do: "corrupt.#{n}")]
      assert Enum.sort(Path.wildcard(file <> ".corrupt*")) == Enum.map(names, &"#{file}.#{&1}")

      for {name, n} <- Enum.with_index(names, 1),
          n < 9,
          do: assert(File.read!("#{file}.#{name}") == "garbage #{n}")

      assert File.read!("#{file}.corrupt.9") == "garbage 12"
    end

    test "stays as it is while it cannot be replaced, and what it has is used", %{
      folder: folder,
      whole: whole
    } do
      file = Path.join(folder, "held")
      cut = binary_part(whole, 0, byte_size(whole) - 1)
      File.write!(file, cut)
      File.mkdir_p!(file <> ".new/in the way")

      capture_log(fn ->
        store = open!(file)
        assert loaded(store) == @all
        assert %{kept_as: nil} = Log.damage(store)
        assert {:error, _} = Log.save(store, [:e], 5)
        assert File.read!(file) == cut
        File.rm_rf!(file <> ".new")
        assert Log.save(store, [:e], 5) == :ok
      end)

      assert File.read!(file <> ".corrupt") == cut
      assert kept(file) == Map.put(@all, [:e], 5)
    end

    test "sets an alarm of its robot, with what is lost, and the robot has the generation before",
         %{robot: robot, stored: file} do
      start_supervised!(robot)
      :ok = Parameter.set_many(robot, [{[:gain], 2.0}, {[:note], String.duplicate("n", 3_000)}])
      stop_supervised!(robot)
      start_supervised!(robot)
      :ok = Parameter.set(robot, [:mode], :wild)
      stop_supervised!(robot)
      File.write!(file, binary_part(File.read!(file), 0, 50))

      log = capture_log(fn -> start_supervised!(robot) end)
      assert log =~ "#{inspect(robot)}: the parameter store #{file} cannot be read as a whole"
      kept_as = file <> ".corrupt"
      assert [%{file: ^file, kept_as: ^kept_as, lost: :unknown}] = alarm(robot, :damaged)
      assert Parameter.get!(robot, [:gain]) == 2.0
      assert byte_size(Parameter.get!(robot, [:note])) == 3_000
      assert Parameter.get!(robot, [:mode]) == :calm
      assert Parameter.set(robot, [:gain], 3.0) == :ok
      stop_supervised!(robot)
      assert alarm(robot, :damaged) == []
    end
  end

  describe "a place that cannot keep" do
    # What every such place has in common: `broken` and `mended` are functions.
    defp assert_recovers(robot, broken, mended, words) do
      log =
        capture_log(fn ->
          broken.()
          {:ok, _} = robot.start_link()
          {:ok, _} = BB.subscribe(robot, [:param])
          unkept = Enum.find(1..2_000, &(Parameter.set(robot, [:note], note(&1)) != :ok))
          assert unkept, "nothing was refused"
          note = note(unkept)
          assert {:error, {:not_kept, reason}} = Parameter.set(robot, [:note], note)
          assert {:error, {:not_kept, ^reason}} = Parameter.set_many(robot, [{[:gain], 2.0}])
          assert Parameter.get!(robot, [:gain]) == 2.0
          assert_received {:bb, [:param, :gain], %{payload: %{new_value: 2.0}}}
          assert [%{store: Log, reason: ^reason, description: said}] = alarm(robot, :not_kept)
          assert said =~ words

          mended.()
          assert eventually(fn -> alarm(robot, :not_kept) == [] end, 60_000)
          assert Parameter.set(robot, [:mode], :wild) == :ok
          Supervisor.stop(robot)
          {:ok, _} = robot.start_link()
          assert Parameter.get!(robot, [:note]) == note
          assert {Parameter.get!(robot, [:gain]), Parameter.get!(robot, [:mode])} == {2.0, :wild}
          Supervisor.stop(robot)
        end)

      assert log =~ words
      assert log =~ "saves values again"
    end

    defp note(n), do: String.pad_leading("#{n}", 100, "-")

    test "since it is a folder", %{robot: robot, stored: file} do
      assert_recovers(
        robot,
        fn -> File.mkdir_p!(file) end,
        fn -> File.rmdir!(file) end,
        "illegal operation on a directory"
      )
    end

    test "since the folder cannot be made", %{robot: robot, stored: file} do
      folder = Path.dirname(file)

      assert_recovers(
        robot,
        fn -> File.write!(folder, "a file") end,
        fn -> File.rm!(folder) end,
        "not a directory"
      )
    end

    test "where no folder can ever be made says so" do
      robot = robot_with("/proc/nowhere/params")
      log = capture_log(fn -> start_supervised!(robot) end)
      assert log =~ "cannot open the parameter store BB.Parameter.Store.Log: no such file or dir"
      assert {:error, {:not_kept, :enoent}} = Parameter.set(robot, [:gain], 2.0)
      assert {:error, :einval} = Log.init(SomeRobot, path: "/dev/full")
    end

    test "since something is in the way of a new file", %{robot: robot, stored: file} do
      start_supervised!(robot)
      stop_supervised!(robot)

      assert_recovers(
        robot,
        fn -> File.mkdir_p!(file <> ".new") end,
        fn -> File.rmdir!(file <> ".new") end,
        "not owner"
      )
    end

    test "when the disk is full while it runs, or is full at the start" do
      with {:ok, folder} <- mount(128) do
        robot = robot_with(Path.join(folder, "params"))
        start_supervised!(robot)
        :ok = Parameter.set(robot, [:gain], 7.0)
        stop_supervised!(robot)
        assert_recovers(robot, fn -> fill(folder) end, fn -> free(folder) end, "no space left")

        robot = robot_with(Path.join(folder, "other"))
        assert_recovers(robot, fn -> fill(folder) end, fn -> free(folder) end, "no space left")
        refute File.exists?(Path.join(folder, "params.new"))
      end
    end

    test "a value for which there is no room, although others have some" do
      with {:ok, folder} <- mount(128) do
        robot = robot_with(Path.join(folder, "params"))
        start_supervised!(robot)
        large = :binary.copy("x", 200_000)
        assert Parameter.set(robot, [:note], large) == {:error, {:not_kept, :enospc}}
        assert Parameter.set_many(robot, [{[:gain], 2.0}, {[:mode], :wild}]) == :ok
        assert [_] = alarm(robot, :not_kept)
        assert Parameter.set(robot, [:note], "small") == :ok
        assert alarm(robot, :not_kept) == []
      end
    end

    test "when it is read-only, what it has is used" do
      with {:ok, folder} <- mount(128) do
        file = Path.join(folder, "params")
        keep(file, [%{[:gain] => 5.0}])
        robot = robot_with(file)
        start_supervised!(robot)
        assert Parameter.get!(robot, [:gain]) == 5.0
        stop_supervised!(robot)

        read_only = fn -> remount(folder, "ro") end

        assert_recovers(
          robot,
          read_only,
          fn -> remount(folder, "rw") end,
          "read-only file system"
        )
      end
    end

    test "when it is read-only and damaged, what can be read is used" do
      with {:ok, folder} <- mount(128) do
        file = Path.join(folder, "params")
        keep(file, [%{[:gain] => 5.0}])
        cut = binary_part(File.read!(file), 0, 4_000)
        File.write!(file, cut)
        remount(folder, "ro")
        robot = robot_with(file)
        log = capture_log(fn -> start_supervised!(robot) end)
        assert log =~ "cannot be read as a whole; no value is lost; the file keeps its name"
        assert log =~ "cannot be rewritten: read-only file system"
        assert Parameter.get!(robot, [:gain]) == 5.0
        assert [%{kept_as: nil, lost: 0}] = alarm(robot, :damaged)
        remount(folder, "rw")
        assert Parameter.set(robot, [:gain], 6.0) == :ok
        assert File.read!(file <> ".corrupt") == cut
      end
    end
  end

  describe "a file that changes while the robot runs" do
    setup %{stored: file} do
      store = open!(file)
      :ok = Log.save(store, [:a], 1)
      %{store: store}
    end

    test "and is removed is written anew with all values", %{store: store, stored: file} do
      File.rm!(file)
      capture_log(fn -> assert Log.save(store, [:b], 2) == :ok end)
      assert kept(file) == %{[:a] => 1, [:b] => 2}
    end

    test "and is damaged is kept and written anew", %{store: store, stored: file} do
      File.write!(file, "garbage")
      log = capture_log(fn -> assert Log.save(store, [:b], 2) == :ok end)
      assert log =~ "#{file} was changed by another process"
      assert kept(file) == %{[:a] => 1, [:b] => 2}
      assert File.read!(file <> ".corrupt") == "garbage"
    end

    test "since another robot has it too loses nobody's values", %{store: store, stored: file} do
      capture_log(fn ->
        other = open!(file)
        assert Log.save(other, [:b], 2) == :ok
        assert Log.save(store, [:c], 3) == :ok
        assert Log.save(other, [:d], 4) == :ok
      end)

      assert kept(file) == %{[:a] => 1, [:b] => 2, [:c] => 3, [:d] => 4}
    end

    test "and becomes a folder refuses until it is gone", %{store: store, stored: file} do
      File.rm!(file)
      File.mkdir!(file)
      capture_log(fn -> assert {:error, _} = Log.save(store, [:b], 2) end)
      File.rmdir!(file)
      assert Log.save(store, [:b], 2) == :ok
      assert kept(file) == %{[:a] => 1, [:b] => 2}
    end
  end

  test "what a kill left beside the file is no hindrance", %{stored: file} do
    keep(file, [%{[:a] => 1}])
    for ending <- ~w(.new .previous.new .import), do: File.write!(file <> ending, "half")
    keep(file, [%{[:b] => 2}])
    assert kept(file) == %{[:a] => 1, [:b] => 2}
  end

  test "a file of a later release stays as it is, and costs a warning",
       %{stored: file} = context do
    %{robot: robot} = context
    keep(file, [%{[:a] => 1}])
    <<magic::binary-8, 1::16, rest::binary-14, _sum::32, frames::binary>> = File.read!(file)
    head = <<magic::binary, 2::16, rest::binary>>
    sum = :erlang.crc32(:erlang.crc32(<<0::32>>), head)
    later = <<head::binary, sum::32, frames::binary>>
    File.write!(file, later)
    log = capture_log(fn -> start_supervised!(robot) end)
    assert log =~ "the file was written by a later release (format 2)"
    assert {:error, {:not_kept, {:version, 2}}} = Parameter.set(robot, [:gain], 2.0)
    assert File.read!(file) == later
  end

  test "values with atoms that the VM does not know are read while they are few, or stay there",
       %{stored: file} do
    # As another VM wrote them: a value is a list of atoms that this one has never seen.
    new = fn n -> "never_seen_here_#{n}" end
    data = fn names -> [<<131, 108, length(names)::32>>, Enum.map(names, &atom/1), <<106>>] end
    {few, _} = Entry.encode([:few], nil)
    {many, _} = Entry.encode([:many], nil)
    few = {few, IO.iodata_to_binary(data.(Enum.map(1..10, new)))}
    many = {many, IO.iodata_to_binary(data.(Enum.map(11..10_000, new)))}
    {bytes, _} = Format.new(1, [few, many], [])
    File.mkdir_p!(Path.dirname(file))
    File.write!(file, bytes)

    log =
      capture_log(fn ->
        store = open!(file)
        assert [{[:few], [_ | _] = atoms}] = Map.to_list(loaded(store))
        assert Enum.map(atoms, &Atom.to_string/1) == Enum.map(1..10, new)
        :ok = Log.save(store, [:other], 1)
      end)

    assert log =~ "has 1 values that this robot cannot read, which stay in the file"
    assert {:ok, reading} = Format.read(File.read!(file))
    assert many in reading.entries
  end

  defp atom(name), do: <<119, byte_size(name), name::binary>>

  describe "a file of DETS at the path" do
    defp keep_dets(file, rows) do
      {:ok, table} = :dets.open_file(make_ref(), file: to_charlist(file), type: :set)
      :ok = :dets.insert(table, rows)
      :ok = :dets.close(table)
      File.read!(file)
    end

    setup %{stored: file} do
      File.mkdir_p!(Path.dirname(file))
      :ok
    end

    test "is taken over, and stays beside it", %{robot: robot, stored: file} do
      old = robot_with(file, Dets)
      start_supervised!(old)
      :ok = Parameter.set_many(old, [{[:gain], 2.0}, {[:rate], ~u(9 hertz)}, {[:mode], :wild}])
      stop_supervised!(old)
      bytes = File.read!(file)

      log = capture_log([level: :info], fn -> start_supervised!(robot) end)
      assert log =~ "imported a DETS file, which is renamed to #{file}.dets"
      assert Parameter.get!(robot, [:gain]) == 2.0
      assert Parameter.get!(robot, [:rate]) == ~u(9 hertz)
      assert Parameter.get!(robot, [:mode]) == :wild
      assert alarm(robot, :damaged) == []
      assert File.read!(file <> ".dets") == bytes
      assert :ok = Parameter.set(robot, [:gain], 3.0)
      stop_supervised!(robot)
      assert kept(file) == %{[:gain] => 3.0, [:rate] => ~u(9 hertz), [:mode] => :wild}
      assert Path.wildcard(file <> ".import") == []
    end

    test "may be one of Beam Bots", %{stored: file} do
      keep_dets(file, [{{:param, [:a]}, 1}, {{:param, [:b]}, 1}, {[:b], 2}, {:odd, 3}])
      capture_log(fn -> assert kept(file) == %{[:a] => 1, [:b] => 2} end)
    end

    test "of which values are missing is kept as a damaged one, and they are counted",
         %{stored: file} do
      bytes = keep_dets(file, for(n <- 1..40, do: {[:"p#{n}"], n}))

      for size <- [byte_size(bytes) - 1, 6_000, 3_000, 100, 10] do
        for leftover <- Path.wildcard(file <> "*"), do: File.rm!(leftover)
        cut = binary_part(bytes, 0, size)
        File.write!(file, cut)

        capture_log(fn ->
          store = open!(file)
          missing = 40 - map_size(loaded(store))

          if missing > 0 do
            assert %{lost: lost, kept_as: kept_as} = Log.damage(store)
            assert lost in [missing, :unknown]
            assert File.read!(kept_as) == cut
          end
        end)
      end
    end
  end

  test "fifty processes that set at once are all told :ok, and all is kept", %{stored: file} do
    params = for n <- 1..50, do: quote(do: param(unquote(:"p#{n}"), type: :integer, default: 0))

    robot =
      create(
        quote do
          settings parameter_store: {BB.Parameter.Store.Log, path: unquote(file)}
          parameters(do: unquote({:__block__, [], params}))
        end
      )

    start_supervised!(robot)
    set = fn n -> for value <- 1..20, do: Parameter.set(robot, [:"p#{n}"], value) end
    answers = 1..50 |> Enum.map(&Task.async(fn -> set.(&1) end)) |> Task.await_many(:infinity)
    assert answers |> List.flatten() |> Enum.uniq() == [:ok]
    as_the_power_fails = File.read!(file)
    File.write!(file <> ".copy", as_the_power_fails)
    assert kept(file <> ".copy") == for(n <- 1..50, into: %{}, do: {[:"p#{n}"], 20})
  end
end

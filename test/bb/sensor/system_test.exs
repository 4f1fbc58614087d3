defmodule BB.Sensor.SystemTest do
  use ExUnit.Case, async: true

  import BB.Test.KernelFiles

  alias BB.Message.System.Status
  alias BB.Sensor.System
  alias BB.Test.Bench

  @moduletag :tmp_dir

  @meminfo "MemTotal:        1000000 kB\nMemFree:          100000 kB\nMemAvailable:     400000 kB\n"
  @throttled "sys/devices/platform/soc/soc:firmware/get_throttled"

  setup %{tmp_dir: root} do
    put(root, "proc/meminfo", @meminfo)
    put(root, "proc/loadavg", "0.25 1.50 2.00 3/120 4711\n")
    put(root, "sys/devices/system/cpu/online", "0-3\n")
    %{bench: Bench.new(System, %{}), root: root}
  end

  defp zone(root, number, type, temperature) do
    put(root, "sys/class/thermal/thermal_zone#{number}/type", type <> "\n")
    put(root, "sys/class/thermal/thermal_zone#{number}/temp", "#{temperature}\n")
  end

  test "a board has all values", %{bench: bench, root: root} do
    zone(root, 0, "cpu-thermal", 61_350)
    put(root, @throttled, "50000\n")
    Bench.start!(bench, root: root, rate: 10)
    message = Bench.reading()
    assert message.frame_id == :sensor

    assert message.payload == %Status{
             temperature: 61.35,
             throttling: [],
             throttled_before: [:under_voltage, :throttled],
             memory_total: 1_024_000_000,
             memory_available: 409_600_000,
             load_1_min: 0.25,
             load_5_min: 1.5,
             load_15_min: 2.0,
             processors: 4
           }
  end

  test "a value without a file is nil", %{bench: bench, root: root} do
    Bench.start!(bench, root: root, rate: 10)

    assert %Status{temperature: nil, throttling: nil, throttled_before: nil} =
             Bench.reading().payload
  end

  test "each message has the values of the files at its time", %{bench: bench, root: root} do
    zone(root, 0, "cpu-thermal", 50_000)
    Bench.start!(bench, root: root, rate: 10)
    assert Bench.reading().payload.temperature == 50.0
    zone(root, 0, "cpu-thermal", 80_000)
    assert Bench.reading(&(&1.payload.temperature == 80.0))
  end

  describe "the thermal zone" do
    test "is the processor's", %{bench: bench, root: root} do
      zone(root, 0, "acpitz", 20_000)
      zone(root, 10, "x86_pkg_temp", 40_000)
      Bench.start!(bench, root: root, rate: 10)
      assert Bench.reading().payload.temperature == 40.0
    end

    test "is the first when none is the processor's", %{bench: bench, root: root} do
      zone(root, 10, "iwlwifi", 40_000)
      zone(root, 2, "acpitz", 20_000)
      Bench.start!(bench, root: root, rate: 10)
      assert Bench.reading().payload.temperature == 20.0
    end

    test "is the one of the options", %{bench: bench, root: root} do
      zone(root, 0, "cpu-thermal", 40_000)
      zone(root, 1, "gpu-thermal", 45_000)
      Bench.start!(bench, root: root, thermal_zone: "gpu-thermal", rate: 10)
      assert Bench.reading().payload.temperature == 45.0
    end

    test "of the options has to exist", %{bench: bench, root: root} do
      zone(root, 0, "cpu-thermal", 40_000)

      assert Bench.start(bench, root: root, thermal_zone: "gpu") ==
               {:error, {:no_thermal_zone, "gpu", ["cpu-thermal"]}}
    end
  end

  describe "a file" do
    test "that is missing from the start keeps the sensor down", %{bench: bench, root: root} do
      path = Path.join(root, "proc/meminfo")
      File.rm!(path)
      assert Bench.start(bench, root: root) == {:error, {:unreadable, path, :enoent}}
    end

    test "of an unexpected format is an error with its text", %{bench: bench, root: root} do
      put(root, "proc/loadavg", "none\n")
      path = Path.join(root, "proc/loadavg")
      assert Bench.start(bench, root: root) == {:error, {:unexpected, path, "none\n"}}
      assert System.explain({:unexpected, path, "none\n"}) =~ ~S("none\n")
    end

    test "that is removed later stops it with the reason, and nothing is published", %{
      bench: bench,
      root: root
    } do
      zone(root, 0, "cpu-thermal", 50_000)
      pid = Bench.start!(bench, root: root, rate: 10)
      path = Path.join(root, "sys/class/thermal/thermal_zone0/temp")
      fault = fn -> File.rm!(path) end
      assert Bench.reason_after(pid, fault) == {:shutdown, {:unreadable, path, :enoent}}
    end
  end

  test "this machine's own files can be read", %{bench: bench} do
    Bench.start!(bench, rate: 10)
    assert %Status{memory_total: total, processors: processors} = Bench.reading().payload
    assert total > 0 and processors > 0
  end

  test "new options take effect", %{bench: bench, root: root} do
    zone(root, 0, "cpu-thermal", 40_000)
    zone(root, 1, "gpu-thermal", 45_000)
    {:ok, sensor} = System.init(Bench.options(bench, root: root))

    assert {:ok, sensor} =
             System.handle_options(
               Bench.options(bench, root: root, thermal_zone: "gpu-thermal"),
               sensor
             )

    assert {:ok, %{temperature: 45.0}, _files} = System.measure(sensor.device, 0)
  end
end

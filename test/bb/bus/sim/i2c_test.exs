defmodule BB.Bus.Sim.I2CTest do
  use ExUnit.Case, async: true

  alias BB.Bus.Sim
  alias BB.Bus.Sim.I2C

  # Counts its reads, so that a test sees which transfers reached it.
  defmodule Counter do
    @behaviour BB.Bus.Sim.Device

    @impl true
    def init(_opts, _now_ns), do: {:ok, 0}

    @impl true
    def write("nak", _now_ns, count), do: {:nak, count}
    def write(<<count>>, _now_ns, _count), do: {:ok, count}

    @impl true
    def read(size, _now_ns, count), do: {:ok, :binary.copy(<<count>>, size), count + 1}
  end

  setup context do
    name = "i2c-#{:erlang.phash2({__MODULE__, context.test})}"
    start_supervised!({Sim, buses: %{name => [devices: %{0x42 => {Counter, []}}]}})
    {:ok, bus} = I2C.open(name)
    %{name: name, bus: bus}
  end

  test "it has the functions that a driver uses of Circuits.I2C" do
    BB.Test.Circuits.assert_i2c(I2C)
  end

  test "a missing bus is not found" do
    assert I2C.open("i2c-none") == {:error, :bus_not_found}
    assert I2C.detect_devices("i2c-none") == {:error, :bus_not_found}
  end

  test "reads, writes and both at once reach the device", %{bus: bus} do
    assert I2C.write(bus, 0x42, [7]) == :ok
    assert I2C.read(bus, 0x42, 2) == {:ok, <<7, 7>>}
    assert I2C.write_read(bus, 0x42, <<1>>, 1) == {:ok, <<1>>}
  end

  test "nothing answers at an address without a device", %{bus: bus} do
    assert I2C.read(bus, 0x43, 1) == {:error, :i2c_nak}
    assert I2C.write(bus, 0x43, <<1>>) == {:error, :i2c_nak}
    assert I2C.write_read(bus, 0x43, <<1>>, 1) == {:error, :i2c_nak}
  end

  test "a device that refuses the bytes is not read", %{bus: bus} do
    assert I2C.write_read(bus, 0x42, "nak", 1) == {:error, :i2c_nak}
    assert I2C.read(bus, 0x42, 1) == {:ok, <<0>>}
  end

  test "an empty write only asks whether the device is there", %{bus: bus} do
    assert I2C.write(bus, 0x42, <<>>) == :ok
    assert I2C.write(bus, 0x43, <<>>) == {:error, :i2c_nak}
  end

  test "devices are detected without being read", %{bus: bus, name: name} do
    assert I2C.detect_devices(bus) == [0x42]
    assert I2C.detect_devices(name) == [0x42]
    assert I2C.read(bus, 0x42, 1) == {:ok, <<0>>}
  end

  test "addresses of memory chips are detected by reading", %{bus: bus, name: name} do
    :ok = Sim.plug(name, 0x50, {Counter, []})
    assert I2C.device_present?(bus, 0x50)
    assert I2C.read(bus, 0x50, 1) == {:ok, <<1>>}
  end

  test "a closed handle is closed for all its users, and other handles are not", %{
    bus: bus,
    name: name
  } do
    {:ok, other} = I2C.open(name)
    assert I2C.close(bus) == :ok
    assert I2C.close(bus) == :ok

    assert Task.await(Task.async(fn -> I2C.read(bus, 0x42, 1) end), :infinity) ==
             {:error, {:errno, 9}}

    assert I2C.write(bus, 0x42, <<1>>) == {:error, {:errno, 9}}
    assert I2C.read(other, 0x42, 1) == {:ok, <<0>>}
  end

  test "a bus that was stopped is a missing device of the kernel", %{bus: bus, name: name} do
    stop_supervised!({Sim, [name]})
    assert I2C.read(bus, 0x42, 1) == {:error, {:errno, 19}}
    assert I2C.open(name) == {:error, :bus_not_found}
    refute name in I2C.bus_names()
  end

  test "more than 8192 bytes at once are refused", %{bus: bus} do
    assert {:ok, _} = I2C.read(bus, 0x42, 8192)
    assert I2C.read(bus, 0x42, 8193) == {:error, {:errno, 22}}
    assert I2C.write(bus, 0x42, :binary.copy(<<0>>, 8193)) == {:error, {:errno, 22}}
  end

  test "timeouts are counted in steps of 10 ms, at least one", %{name: name} do
    for {asked, given} <- [{-1, 1000}, {0, 10}, {4, 10}, {14, 10}, {15, 20}, {50, 50}] do
      {:ok, bus} = I2C.open(name, timeout: asked)
      assert bus.timeout_ms == given
    end
  end

  test "wrong arguments raise", %{bus: bus, name: name} do
    BB.Test.Circuits.assert_i2c_raises(I2C, name, bus)
  end

  test "transfers from many processes follow one another", %{bus: bus} do
    answers =
      1..50
      |> Enum.map(fn _ -> Task.async(fn -> I2C.read(bus, 0x42, 2) end) end)
      |> Task.await_many(:infinity)

    assert Enum.sort(answers) == for(n <- 0..49, do: {:ok, <<n, n>>})
  end
end

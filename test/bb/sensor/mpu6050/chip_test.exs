defmodule BB.Sensor.Mpu6050.ChipTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually

  alias BB.Bus.I2C.Device
  alias BB.Bus.Sim
  alias BB.Bus.Sim.I2C
  alias BB.Sensor.Mpu6050.Chip

  @address 0x68
  @settings %{divider: 4, filter: 94, gyro_range: 1000, accel_range: 8}
  @at_rest %{
    acceleration: {0.0, 0.0, 9.80665},
    angular_velocity: {0.0, 0.0, 0.0},
    temperature: 25.0
  }

  # A reset takes no time here, so nothing is waited for.
  setup context do
    name = "i2c-#{:erlang.phash2({__MODULE__, context.test})}"
    opts = [reset_ms: 0, source: {:stepped, [@at_rest]}]
    device = {Sim.Mpu6050, Keyword.merge(opts, Map.get(context, :device, []))}
    start_supervised!({Sim, buses: %{name => [devices: %{@address => device}]}})
    {:ok, device} = Device.open(i2c: I2C, bus: name, address: @address, timeout: 10)
    %{name: name, chip: %Chip{device: device, settings: @settings}}
  end

  defp register(name, address, count) do
    {:ok, bus} = I2C.open(name)
    {:ok, bytes} = I2C.write_read(bus, @address, <<address>>, count)
    bytes
  end

  test "it is identified", %{chip: chip} do
    assert Chip.identify(chip) == {:ok, chip}
    assert Chip.identify(chip, :mpu6050) == {:ok, chip}
  end

  @tag device: [who_am_i: 0x19]
  test "another chip is not taken for it", %{chip: chip, name: name} do
    assert Chip.identify(chip) == {:error, {:wrong_chip, name, 0x68, 0x19, 0x68}}
  end

  @tag device: [model: :mpu9250]
  test "another model of the family is identified, and refused when one is required",
       context do
    %{chip: chip, name: name} = context
    assert {:ok, %{model: :mpu9250}} = Chip.identify(chip)
    assert Chip.identify(chip, :mpu6500) == {:error, {:wrong_chip, name, 0x68, 0x71, 0x70}}
  end

  test "reset and configured, it has exactly the settings, all else as after power-on", %{
    chip: chip,
    name: name
  } do
    {:ok, bus} = I2C.open(name)
    :ok = I2C.write(bus, @address, <<0x37, 0x10, 0xFF>>)

    assert Chip.reset(chip) == :ok
    assert Chip.configure(chip) == :ok

    bytes = register(name, 0, 128)

    written =
      for {byte, at} <- Enum.with_index(:binary.bin_to_list(bytes)),
          byte != 0,
          at not in 0x3A..0x48,
          do: {at, byte}

    assert written == [
             {0x19, 4},
             {0x1A, 2},
             {0x1B, 0x10},
             {0x1C, 0x10},
             {0x37, 0x10},
             {0x6B, 0x01},
             {0x75, 0x68}
           ]
  end

  @tag device: [reset_ms: 60_000]
  test "that does not keep its settings is an error", %{chip: chip, name: name} do
    :ok = Chip.reset(chip)
    assert Chip.configure(chip) == {:error, {:not_configured, name, @address}}
  end

  test "a sample is in SI units", %{chip: chip} do
    :ok = Chip.configure(chip)
    assert {:ok, %{acceleration: {+0.0, +0.0, z}}, _new?} = Chip.sample(chip)
    assert_in_delta z, 9.80665, 9.80665 / 4096
  end

  test "that lost its power for a moment gives no sample", %{chip: chip, name: name} do
    :ok = Chip.configure(chip)
    assert {:ok, _reading, _new?} = Chip.sample(chip)
    :ok = Sim.unplug(name, @address)
    :ok = Sim.replug(name, @address)
    assert Chip.sample(chip) == {:error, {:restarted, name, @address}}
    assert Chip.fifo_count(chip) == {:error, {:restarted, name, @address}}
  end

  @tag device: [model: :mpu6500]
  test "a successor, which is awake then, gives no sample either", %{chip: chip, name: name} do
    {:ok, chip} = Chip.identify(chip)
    :ok = Chip.configure(chip)
    :ok = Sim.unplug(name, @address)
    :ok = Sim.replug(name, @address)
    assert Chip.sample(chip) == {:error, {:restarted, name, @address}}
  end

  @tag device: [model: :mpu6500]
  test "a successor gets the filter of its accelerometer too, and its own temperature", context do
    {:ok, chip} = Chip.identify(context.chip)
    :ok = Chip.configure(chip)
    assert register(context.name, 0x1D, 1) == <<2>>
    assert {:ok, %{temperature: temperature}, _new?} = Chip.sample(chip)
    assert_in_delta temperature, 25.0, 0.01
  end

  @tag device: [source: &__MODULE__.slope/1]
  test "the FIFO gives every sample since it was started, in order", %{chip: chip} do
    chip = %{chip | settings: %{@settings | divider: 49}}
    :ok = Chip.configure(chip)
    assert Chip.fifo_count(chip) == {:ok, 0}
    :ok = Chip.start_fifo(chip)
    count = eventually(fn -> several(chip) end)
    {:ok, readings} = Chip.take(chip, count)
    steps = for %{acceleration: {x, _, _}} <- readings, do: round(x * 4096 / 9.80665)
    assert length(steps) == count
    assert steps == Enum.to_list(hd(steps)..List.last(steps)//50)
  end

  # One step of the ±8 g range a millisecond.
  def slope(seconds),
    do: %{@at_rest | acceleration: {seconds * 1000 * 9.80665 / 4096, 0.0, 0.0}}

  defp several(chip) do
    {:ok, count} = Chip.fifo_count(chip)
    if count >= 4, do: count
  end

  @tag device: [source: &__MODULE__.slope/1]
  test "an overflow of the FIFO is an error, once", %{chip: chip, name: name} do
    chip = %{chip | settings: %{@settings | divider: 0, filter: 260}}
    :ok = Chip.configure(chip)
    :ok = Chip.start_fifo(chip)
    assert {:error, {:overflow, ^name, @address}} = eventually(fn -> overflow(chip) end)
  end

  defp overflow(chip) do
    with {:ok, _count} <- Chip.fifo_count(chip), do: false
  end

  test "each function returns the error of the bus", %{chip: chip, name: name} do
    for {fault, reason} <- [
          nak: {:no_answer, name, @address},
          enxio: {:no_answer, name, @address},
          timeout: {:timeout, name, @address},
          retry: {:bus, name, @address, :retry}
        ],
        function <- [:identify, :reset, :configure, :sample, :start_fifo, :fifo_count] do
      :ok = Sim.fault(name, @address, fault)
      assert apply(Chip, function, [chip]) == {:error, reason}
    end
  end

  test "a closed bus is an error of the bus", %{chip: chip, name: name} do
    :ok = Chip.close(chip)
    assert Chip.sample(chip) == {:error, {:bus, name, @address, {:errno, 9}}}
  end
end

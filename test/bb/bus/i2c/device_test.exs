defmodule BB.Bus.I2C.DeviceTest do
  use ExUnit.Case, async: true

  alias BB.Bus.I2C.Device
  alias BB.Bus.Sim
  alias BB.Bus.Sim.I2C

  doctest BB.Bus.I2C.Device

  setup context do
    name = "i2c-#{:erlang.phash2({__MODULE__, context.test})}"
    start_supervised!({Sim, buses: %{name => [devices: %{0x68 => {Sim.Mpu6050, []}}]}})
    opts = [i2c: I2C, bus: name, address: 0x68, timeout: 10]
    {:ok, device} = Device.open(opts)
    %{name: name, opts: opts, device: device}
  end

  test "its registers are read and written", %{device: device} do
    assert Device.write(device, 0x6B, <<0x01>>) == :ok
    assert Device.read(device, 0x6B, 2) == {:ok, <<0x01, 0x00>>}
  end

  test "it is identified by the content of a register, a byte or several", %{
    device: device,
    name: name
  } do
    assert Device.identify(device, 0x75, 0x68) == :ok
    assert Device.identify(device, 0x75, 0x70) == {:error, {:wrong_chip, name, 0x68, 0x68, 0x70}}

    assert Device.identify(device, 0x75, <<0x68, 0>>) == :ok

    assert Device.identify(device, 0x75, "LUNA") ==
             {:error, {:wrong_chip, name, 0x68, <<0x68, 0, 0, 0>>, "LUNA"}}
  end

  test "each error of the bus is a reason that names the place", %{device: device, name: name} do
    for {fault, reason} <- [
          nak: {:no_answer, name, 0x68},
          enxio: {:no_answer, name, 0x68},
          timeout: {:timeout, name, 0x68},
          retry: {:bus, name, 0x68, :retry}
        ] do
      :ok = Sim.fault(name, 0x68, fault)
      assert Device.read(device, 0x75, 1) == {:error, reason}
      assert Device.write(device, 0x6B, <<0>>) == {:error, reason}
      assert Device.identify(device, 0x75, 0x68) == {:error, reason}
    end
  end

  test "a missing bus is an error", %{opts: opts} do
    assert Device.open(Keyword.put(opts, :bus, "i2c-none")) ==
             {:error, {:bus_not_found, "i2c-none"}}
  end

  test "closed, it answers with the bus's error", %{device: device, name: name} do
    :ok = Device.close(device)
    assert Device.read(device, 0x75, 1) == {:error, {:bus, name, 0x68, {:errno, 9}}}
  end

  test "a device that cannot be made ready is closed", %{opts: opts} do
    assert {:error, device} = Device.open(opts, &{:error, &1})
    assert {:error, {:bus, _, _, {:errno, 9}}} = Device.read(device, 0x75, 1)
    assert {:ok, device} = Device.open(opts, &{:ok, &1})
    assert {:ok, <<0x68>>} = Device.read(device, 0x75, 1)
  end

  test "identities of letters are shown as letters" do
    assert Device.explain({:wrong_chip, "i2c-1", 0x10, <<0, 0, 0, 0>>, "LUNA"}) =~
             ~s(identifies itself as <<0, 0, 0, 0>> instead of "LUNA")

    assert Device.explain({:wrong_chip, "i2c-1", 0x40, <<1, 2>>, <<0x39, 0x9F>>}) =~
             "0x0102 instead of 0x399F"
  end

  test "every reason is explained with the name of the place" do
    for reason <- [
          {:no_answer, "i2c-7", 0x69},
          {:timeout, "i2c-7", 0x69},
          {:wrong_chip, "i2c-7", 0x69, 0x70, 0x68},
          {:not_configured, "i2c-7", 0x69},
          {:restarted, "i2c-7", 0x69},
          {:bus, "i2c-7", 0x69, {:errno, 5}}
        ] do
      assert Device.explain(reason) =~ "0x69 on i2c-7"
    end

    assert Device.explain({:bus_not_found, "i2c-7"}) =~ "i2c-7"
  end
end

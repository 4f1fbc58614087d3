defmodule BB.Bus.Linux.I2CTest do
  use ExUnit.Case, async: false

  import BB.Test.Linux

  alias BB.Bus.I2C.Device
  alias BB.Bus.Linux
  alias BB.Bus.Linux.I2C
  alias BB.Test.Circuits

  @moduletag :tmp_dir
  setup :use_folder

  # Arguments are checked before the kernel is called.
  @bus %I2C{ref: nil, name: "i2c-1", path: "", inode: nil, retries: 0, flags: []}

  test "has the functions of Circuits 2, each with its arities" do
    assert_functions(I2C,
      open: [1, 2],
      close: [1],
      read: [3, 4],
      read!: [3, 4],
      write: [3, 4],
      write!: [3, 4],
      write_read: [4, 5],
      write_read!: [4, 5],
      bus_names: [0],
      detect_devices: [0, 1],
      device_present?: [2],
      discover: [1, 2],
      discover_one: [1, 2],
      discover_one!: [1, 2],
      info: [0, 1]
    )

    Circuits.assert_i2c(I2C)
  end

  test "wrong arguments raise, with the argument in the message" do
    Circuits.assert_i2c_raises(I2C, "i2c-1", @bus)
    assert_raise ArgumentError, ~r/0\.\.127.*got: 208/, fn -> I2C.write(@bus, 0xD0, <<0>>) end
    assert_raise ArgumentError, ~r/timeout/, fn -> I2C.open("i2c-1", timeout: 0x80000000) end
    assert_raise ArgumentError, fn -> I2C.write_read(@bus, 0x10, [256], 1) end
  end

  test "a missing bus is an error for every kind of name" do
    for name <- ["i2c-1", "", ".", "..", "../null", "i2c\0", <<255>>],
        do: assert(I2C.open(name) == {:error, :bus_not_found})

    assert I2C.detect_devices("i2c-1") == {:error, :bus_not_found}
    assert I2C.discover([0x68]) == []
    assert I2C.discover_one([0x68]) == {:error, :not_found}
    assert_raise RuntimeError, "I2C failure: :not_found", fn -> I2C.discover_one!([0x68]) end
  end

  test "a file that is no I2C adapter is refused", %{tmp_dir: folder} do
    for {name, kind} <- strangers(folder, "i2c-") do
      assert {kind, I2C.open(name)} == {kind, {:error, {:errno, 25}}}
    end
  end

  test "buses have the names of their files, ordered by number", %{tmp_dir: folder} do
    for name <- ~w(i2c-10 i2c-2 i2c-x i2c i2c-1), do: File.write!(Path.join(folder, name), "")
    File.ln_s!("i2c-2", Path.join(folder, "i2c-7"))
    assert I2C.bus_names() == ~w(i2c-1 i2c-2 i2c-10)
  end

  test "missing rights are explained with the group that has them, and the remedy", %{
    tmp_dir: folder
  } do
    path = Path.join(folder, "i2c-1")
    File.write!(path, "")

    assert {:error, {:errno, 13}} =
             without_rights(path, fn -> I2C.open("i2c-1") end, "BB.Bus.Linux.I2C.open(\"i2c-1\")")

    File.chmod!(path, 0o660)
    gid = File.stat!(path).gid
    sentence = Linux.explain("i2c-1", {:errno, 13})
    assert sentence =~ "no rights on #{path}"

    if gid != 0 or match?({:ok, _}, chgrp(path, 4)) do
      group = Linux.Rights.group(File.stat!(path).gid, File.read!("/etc/group"))
      assert Linux.explain("i2c-1", {:errno, 13}) =~ "`sudo usermod -aG #{group} $USER`"
      assert Device.explain({:no_rights, "i2c-1"}) =~ "the group #{group} may use"
    end
  end

  test "a driver gets a reason of its own for missing rights" do
    defmodule Locked do
      def open(_name, _opts), do: {:error, {:errno, 13}}
    end

    assert Device.open(i2c: Locked, bus: "i2c-1", address: 0x68, timeout: 20) ==
             {:error, {:no_rights, "i2c-1"}}
  end

  test "a bus may have another name on this machine", %{tmp_dir: folder} do
    configure(folder: folder, names: %{"i2c-1" => "i2c-7"})
    File.write!(Path.join(folder, "i2c-7"), "")
    assert I2C.open("i2c-1") == {:error, {:errno, 25}}
    assert Linux.explain("i2c-1", {:errno, 25}) =~ "#{folder}/i2c-7 is no I2C bus"
  end

  test "the shared bus returns the error of its backend" do
    assert BB.Bus.I2C.open("i2c-1", backend: I2C, timeout: 20) == {:error, :bus_not_found}
  end

  test "a thousand refused openings leave no descriptor and no thread", %{tmp_dir: folder} do
    File.write!(Path.join(folder, "i2c-1"), "")
    open = fn -> {:error, {:errno, 25}} = I2C.open("i2c-1") end
    open.()
    assert_nothing_left(fn -> for _ <- 1..1000, do: open.() end)
  end
end

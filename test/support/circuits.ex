defmodule BB.Test.Circuits do
  @moduledoc "The interface of the library that stands behind a bus on a board."

  import ExUnit.Assertions

  @i2c [
    open: [1, 2],
    read: [3, 4],
    write: [3, 4],
    write_read: [4, 5],
    close: [1],
    bus_names: [0],
    detect_devices: [1],
    device_present?: [2]
  ]

  @doc "Fails unless a module has the functions that a driver uses of `Circuits.I2C` 2."
  def assert_i2c(module) do
    Code.ensure_loaded!(module)

    for {name, arities} <- @i2c, arity <- arities do
      assert function_exported?(module, name, arity), "#{name}/#{arity} is missing"
    end
  end

  @doc "Fails unless wrong arguments raise, those of a transfer with the open `bus` too."
  def assert_i2c_raises(module, name, bus) do
    assert_raise FunctionClauseError, fn -> module.open(:i2c) end
    assert_raise ArgumentError, ~r/timeout/, fn -> module.open(name, timeout: 1.5) end
    assert_raise ArgumentError, ~r/retries/, fn -> module.open(name, retries: -1) end
    assert_raise ArgumentError, ~r/address/, fn -> module.read(bus, "0x42", 1) end
    assert_raise ArgumentError, ~r/address/, fn -> module.read(bus, -1, 1) end
    assert_raise ArgumentError, ~r/bytes to read/, fn -> module.read(bus, 0x42, -1) end
    assert_raise ArgumentError, fn -> module.write(bus, 0x42, [:a]) end
    assert_raise ArgumentError, ~r/retries/, fn -> module.read(bus, 0x42, 1, retries: :many) end
    assert_raise FunctionClauseError, fn -> module.read("i2c-1", 0x42, 1) end
  end
end

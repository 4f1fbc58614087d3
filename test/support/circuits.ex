defmodule BB.Test.Circuits do
  @moduledoc "Checks that a module has the interface of a Circuits library."

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

  @doc "Fails unless a module has the functions of `Circuits.I2C` 2 that drivers use."
  def assert_i2c(module) do
    Code.ensure_loaded!(module)

    for {name, arities} <- @i2c, arity <- arities do
      assert function_exported?(module, name, arity), "#{name}/#{arity} is missing"
    end
  end

  @doc "Fails unless invalid arguments raise, also those of a transfer on the open `bus`."
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

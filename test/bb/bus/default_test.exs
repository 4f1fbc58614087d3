defmodule BB.Bus.DefaultTest do
  @moduledoc "Which buses a robot gets without any configuration."

  # The configuration, and the modules that replace a library, are global.
  use ExUnit.Case, async: false

  import BB.Test.Robot

  alias BB.Bus.{GPIO, I2C, Sim}
  alias BB.Test.Run

  setup do
    before =
      for key <- [:i2c, :gpio], value = Application.get_env(:ganglion, key), do: {key, value}

    for key <- [:i2c, :gpio], do: Application.delete_env(:ganglion, key)

    on_exit(fn ->
      for key <- [:i2c, :gpio], do: Application.delete_env(:ganglion, key)
      for {key, value} <- before, do: Application.put_env(:ganglion, key, value)
    end)
  end

  defp with_circuits(modules) do
    for module <- modules,
        do: {:module, _, _, _} = Module.create(module, nil, Macro.Env.location(__ENV__))

    on_exit(fn ->
      for module <- modules do
        :code.purge(module)
        :code.delete(module)
      end
    end)
  end

  defp simulated(name) do
    robot =
      create(
        quote do
          simulation do
            i2c unquote(name)
            gpio unquote(name)
          end
        end
      )

    start_supervised!(robot)
    {name in Sim.names(), name in Sim.Lines.names()}
  end

  test "they are simulated where Circuits is not" do
    assert I2C.backend() == Sim.I2C
    assert GPIO.module(nil) == Sim.GPIO
    assert simulated(Run.unique("bus")) == {true, true}
  end

  test "they are those of Circuits where it is loaded, and simulations have no effect" do
    with_circuits([Circuits.I2C, Circuits.GPIO])
    assert I2C.backend() == Circuits.I2C
    assert GPIO.module(nil) == Circuits.GPIO
    assert simulated(Run.unique("bus")) == {false, false}
  end

  test "each of them depends on its own library" do
    with_circuits([Circuits.GPIO])
    assert {I2C.backend(), GPIO.module(nil)} == {Sim.I2C, Circuits.GPIO}
    assert simulated(Run.unique("bus")) == {true, false}
  end

  test "the configuration has precedence" do
    with_circuits([Circuits.I2C, Circuits.GPIO])
    Application.put_env(:ganglion, :i2c, Sim.I2C)
    Application.put_env(:ganglion, :gpio, Sim.GPIO)
    assert {I2C.backend(), GPIO.module(nil)} == {Sim.I2C, Sim.GPIO}
    assert simulated(Run.unique("bus")) == {true, true}
  end
end

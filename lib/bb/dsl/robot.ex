defmodule BB.Dsl.Robot do
  @moduledoc "The sections of a robot: the words that `use BB` imports."

  import BB.Dsl.Vocabulary, only: [entity: 5]

  # What values are made of: ~u and param/1.
  @values [BB.Unit, BB.Parameter.Reference]

  @doc """
  What holds for the robot as a whole.

    * `name` - what people call it, an atom
    * `topic_prefix` - what goes before the names of its ring topics, text such as `"rover"` (`BB.Topic`)
    * `parameter_store` - where parameters are kept, `{BB.Parameter.Store.Log, path: "/data/params"}`
    * `registry_module` - a module with the functions of `Registry` for the robot's process registry (`Registry`)
    * `registry_options` - options for its start beside `keys:` and `name:`, such as `[partitions: 2]`
    * `supervisor_module` - a module with `Supervisor.start_link/3` for the robot's supervisors (`Supervisor`)
  """
  defmacro settings(fields),
    do: entity(:settings, [fields], 0, [BB.Dsl.Words.Settings], __CALLER__)

  @doc "The sensors that belong to the robot as a whole and to no link: its battery, its processor."
  defmacro sensors(block),
    do: entity(:sensors, [block], 0, @values ++ [BB.Dsl.Component], __CALLER__)

  @doc "What of the robot can be tuned while it runs: `param` and `group`. See `BB.Parameter`."
  defmacro parameters(block),
    do: entity(:parameters, [block], 0, [BB.Unit, BB.Dsl.Words.Parameters], __CALLER__)

  @doc "The controllers, which belong to the robot as a whole: `controller`."
  defmacro controllers(block),
    do: entity(:controllers, [block], 0, @values ++ [BB.Dsl.Component], __CALLER__)

  @doc "The robot's links and joints, a tree with one root link, and the sensors on them."
  defmacro topology(block),
    do: entity(:topology, [block], 0, @values ++ [BB.Dsl.Words.Topology], __CALLER__)

  @doc """
  What hangs on the buses where they are simulated: `i2c` and `gpio`, with a `device` each.

      simulation do
        i2c "i2c-1", clock_hz: 400_000 do
          device 0x68, {BB.Bus.Sim.Mpu6050, source: :motion}
        end

        gpio "gpiochip0" do
          device :bumper, {BB.Bus.Sim.Contact, pins: [contact: 17]}
        end
      end

  It is started with the robot and below it, where `BB.Bus.I2C.backend/0` or `BB.Bus.GPIO.module/1` is
  the simulation; on a board it stands aside. A bus that runs already is used as it is
  (`BB.Bus.Sim.Wiring` says who goes first).
  """
  defmacro simulation(block),
    do: entity(:simulation, [block], 0, [BB.Unit, BB.Dsl.Simulation], __CALLER__)
end

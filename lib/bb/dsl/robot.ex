defmodule BB.Dsl.Robot do
  @moduledoc """
  The sections of a robot's declaration, which `use BB` imports into the robot's module.

      settings do
        name :my_robot
      end
  """

  import BB.Dsl.Vocabulary, only: [entity: 5]

  # The words inside values: ~u and param/1.
  @values [BB.Unit, BB.Parameter.Reference]

  @doc """
  Declares settings of the whole robot.

    * `name` - the robot's name for people, an atom
    * `topic_prefix` - the prefix of the names of its ring topics, such as `"rover"` (`BB.Topic`)
    * `parameter_store` - the store of its parameters, such as
      `{BB.Parameter.Store.Log, path: "/data/params"}`
    * `registry_module` - a module with the functions of `Registry` for the robot's process
      registry (`Registry`)
    * `registry_options` - options of the registry beside `keys:` and `name:`, such as
      `[partitions: 2]`
    * `supervisor_module` - a module with `Supervisor.start_link/3` for the robot's supervisors
      (`Supervisor`)
  """
  defmacro settings(fields),
    do: entity(:settings, [fields], 0, [BB.Dsl.Words.Settings], __CALLER__)

  @doc "Declares the sensors of the whole robot, such as its battery or its processor."
  defmacro sensors(block),
    do: entity(:sensors, [block], 0, @values ++ [BB.Dsl.Component], __CALLER__)

  @doc "Declares the parameters of the robot: `param` and `group`. See `BB.Parameter`."
  defmacro parameters(block),
    do: entity(:parameters, [block], 0, [BB.Unit, BB.Dsl.Words.Parameters], __CALLER__)

  @doc "Declares the controllers of the robot: `controller`."
  defmacro controllers(block),
    do: entity(:controllers, [block], 0, @values ++ [BB.Dsl.Component], __CALLER__)

  @doc "Declares the links and joints of the robot, a tree with one root link."
  defmacro topology(block),
    do: entity(:topology, [block], 0, @values ++ [BB.Dsl.Words.Topology], __CALLER__)

  @doc """
  Declares the simulated buses, `i2c` and `gpio`, and the devices on them, `device`.

      simulation do
        i2c "i2c-1", clock_hz: 400_000 do
          device 0x68, {BB.Bus.Sim.Mpu6050, source: :motion}
        end

        gpio "gpiochip0" do
          device :bumper, {BB.Bus.Sim.Contact, pins: [contact: 17]}
        end
      end

  The robot starts these buses where `BB.Bus.I2C.backend/0` or `BB.Bus.GPIO.module/1` is the
  simulation. On a board it ignores this section. A bus that runs already is used as it is
  (`BB.Bus.Sim.Wiring` explains which declaration holds).
  """
  defmacro simulation(block),
    do: entity(:simulation, [block], 0, [BB.Unit, BB.Dsl.Simulation], __CALLER__)
end

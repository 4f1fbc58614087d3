defmodule BB.Dsl.Words do
  @moduledoc """
  The words inside the blocks of a robot's declaration, in one module for each kind of block.

  A block imports its words for itself alone, so that no word clashes with a function of the
  robot's module. `BB.Dsl.Robot`, `BB.Dsl.Component` and `BB.Dsl.Simulation` have the other words.

      topology do                                # BB.Dsl.Robot
        link :base_link do                       # BB.Dsl.Words.Topology
          joint :shoulder do                     # BB.Dsl.Words.Link
            type :revolute                       # BB.Dsl.Words.Joint
            limit do                             # BB.Dsl.Words.Joint
              lower ~u(-90 degree)               # BB.Dsl.Words.Limit
              upper ~u(90 degree)
            end

            link :arm                            # BB.Dsl.Words.Topology
          end
        end
      end
  """

  import BB.Dsl.Vocabulary, only: [words: 3]

  # Blocks whose words set fields, and nothing else.

  words(Settings, "`settings`", [
    :name,
    :topic_prefix,
    :parameter_store,
    :registry_module,
    :registry_options,
    :supervisor_module
  ])

  words(Param, "`param`", [:type, :default, :min, :max, :doc])
  words(Controller, "`controller`", [:required])
  words(Transmission, "`transmission`", [:reduction, :offset, :reversed?])
  words(Origin, "`origin`", [:x, :y, :z, :roll, :pitch, :yaw])
  words(Axis, "`axis`", [:x, :y, :z])
  words(Limit, "`limit`", [:lower, :upper, :effort, :velocity])
  words(Dynamics, "`dynamics`", [:damping, :friction])

  # Blocks with entities.

  defmodule Sensor do
    @moduledoc "The words inside `sensor`."
    @moduledoc no_example: "BB.Dsl has an example of the whole language"

    use BB.Dsl.Vocabulary, fields: [:required, :retain, :max_silence]

    @doc """
    Declares the transmission between the sensor and its joint.

    Fields: `reduction`, `offset`, `reversed?` (`BB.Transmission`).
    """
    defmacro transmission(fields),
      do: entity(:transmission, [fields], 0, [BB.Dsl.Words.Transmission], __CALLER__)
  end

  defmodule Actuator do
    @moduledoc "The words inside `actuator`."
    @moduledoc no_example: "BB.Dsl has an example of the whole language"

    use BB.Dsl.Vocabulary, fields: [:required]

    @doc """
    Declares the transmission between the actuator and its joint.

    Fields: `reduction`, `offset`, `reversed?` (`BB.Transmission`).
    """
    defmacro transmission(fields),
      do: entity(:transmission, [fields], 0, [BB.Dsl.Words.Transmission], __CALLER__)
  end

  defmodule Parameters do
    @moduledoc "The words inside `parameters` and `group`."
    @moduledoc no_example: "BB.Dsl has an example of the whole language"

    use BB.Dsl.Vocabulary

    @param [BB.Dsl.Words.Param]
    @group [BB.Dsl.Words.Parameters]

    @doc """
    Declares a parameter.

        param :rate, type: {:unit, :hertz}, default: ~u(100 hertz), min: ~u(1 hertz)

    Fields, as keywords or in a block: `type` (`BB.Parameter.Type`), `default`, `min`, `max`,
    `doc`. A parameter without a default is `nil` until it is set.
    """
    defmacro param(name, fields), do: entity(:param, [name, fields], 1, @param, __CALLER__)

    defmacro param(name, fields, block),
      do: entity(:param, [name, fields, block], 1, @param, __CALLER__)

    @doc """
    Declares a group of parameters and of other groups. The group's name stands in their paths
    before their own names.
    """
    defmacro group(name, block), do: entity(:group, [name, block], 1, @group, __CALLER__)
  end

  defmodule Topology do
    @moduledoc "The words inside `topology`, and for the child link of a joint."
    @moduledoc no_example: "BB.Dsl has an example of the whole language"

    use BB.Dsl.Vocabulary

    @inside [BB.Dsl.Component, BB.Dsl.Words.Link]

    @doc """
    Declares a link, a rigid part of the robot: `link :base_link do … end`, or `link :arm` when
    the link carries nothing.

    A link without a name is called `:link_0`, `:link_1`, …
    """
    defmacro link, do: entity(:link, [], 1, @inside, __CALLER__)
    defmacro link(name_or_block), do: entity(:link, [name_or_block], 1, @inside, __CALLER__)
    defmacro link(name, block), do: entity(:link, [name, block], 1, @inside, __CALLER__)
  end

  defmodule Link do
    @moduledoc "The words inside `link`, beside the words for components."
    @moduledoc no_example: "BB.Dsl has an example of the whole language"

    use BB.Dsl.Vocabulary

    @inside [BB.Dsl.Component, BB.Dsl.Words.Topology, BB.Dsl.Words.Joint]

    @doc """
    Declares a joint, which connects the link around it with the link inside it.

    Inside, or as keywords: `type` (`:revolute`, `:continuous`, `:prismatic` or `:fixed`),
    `origin`, `axis`, `limit`, `dynamics`. Inside only: the joint's sensors, its actuators and its
    child link. A joint without a name is called `:joint_0`, `:joint_1`, …
    """
    defmacro joint(name_or_block), do: entity(:joint, [name_or_block], 1, @inside, __CALLER__)
    defmacro joint(name, block), do: entity(:joint, [name, block], 1, @inside, __CALLER__)

    defmacro joint(name, fields, block),
      do: entity(:joint, [name, fields, block], 1, @inside, __CALLER__)
  end

  defmodule Joint do
    @moduledoc "The words inside `joint`, beside the words for components and for the child link."
    @moduledoc no_example: "BB.Dsl has an example of the whole language"

    use BB.Dsl.Vocabulary, fields: [:type]

    @doc """
    Sets the place of the joint in its parent link: `x`, `y`, `z` (lengths), `roll`, `pitch`,
    `yaw` (angles).
    """
    defmacro origin(fields), do: entity(:origin, [fields], 0, [BB.Dsl.Words.Origin], __CALLER__)

    @doc "Sets the direction in which the joint turns or slides: `x`, `y`, `z` (numbers)."
    defmacro axis(fields), do: entity(:axis, [fields], 0, [BB.Dsl.Words.Axis], __CALLER__)

    @doc """
    Sets the limits of the joint: `lower`, `upper` (angles, or lengths of a prismatic joint),
    `effort` (torque or force), `velocity`.
    """
    defmacro limit(fields), do: entity(:limit, [fields], 0, [BB.Dsl.Words.Limit], __CALLER__)

    @doc "Sets the resistance of the joint: `damping`, `friction` (numbers in SI units)."
    defmacro dynamics(fields),
      do: entity(:dynamics, [fields], 0, [BB.Dsl.Words.Dynamics], __CALLER__)
  end

  defmodule SimulatedBus do
    @moduledoc "The words inside a simulated bus, `i2c` or `gpio`."
    @moduledoc no_example: "BB.Dsl.Robot.simulation/1 has an example"

    use BB.Dsl.Vocabulary

    @doc """
    Declares a simulated device.

    On an I2C bus the device has an address (`BB.Bus.Sim.Device`), on GPIO lines it has a name
    (`BB.Bus.Sim.GPIO.Device`):

        device 0x68, {BB.Bus.Sim.Mpu6050, source: :motion}
        device :bumper, {BB.Bus.Sim.Contact, pins: [contact: 17]}
    """
    defmacro device(place, model), do: entity(:device, [place, model], 2, [], __CALLER__)

    defmacro device(place, model, fields),
      do: entity(:device, [place, model, fields], 2, [], __CALLER__)
  end
end

defmodule BB.Dsl.Glossary do
  @moduledoc """
  What each entity of a robot's declaration is, for the documentation of its word. Pure.

      iex> BB.Dsl.Glossary.text(:texture)
      "Sets the texture of a material, a picture in a file.\\n\\nFields: `filename`."
  """

  alias BB.Dsl.Grammar

  @texts %{
    settings: """
    Declares settings of the whole robot.

      * `name` - the robot's name for people, an atom (the last part of the module's name,
        `:my_robot` for `MyRobot`)
      * `topic_prefix` - the prefix of the names of its ring topics, such as `"rover"`
        (`BB.Topic`)
      * `parameter_store` - the store of its parameters, such as
        `{BB.Parameter.Store.Log, path: "/data/params"}`
      * `registry_module` - a module with the functions of `Registry` for the robot's process
        registry (`Registry`)
      * `registry_options` - options of the registry beside `keys:` and `name:`
        (`[partitions: System.schedulers_online()]`)
      * `supervisor_module` - a module with `Supervisor.start_link/3` for the robot's supervisors
        (`Supervisor`)
      * `topology_max_restarts`, `topology_max_seconds` - accepted for robots written elsewhere
        (`3`, `5`); here a component that fails spends no restarts of the topology
    """,
    parameters: "Declares the parameters of the robot and its bridges. See `BB.Parameter`.",
    sensors: "Declares the sensors of the whole robot, such as its battery or its processor.",
    controllers: "Declares the controllers of the robot.",
    commands: "Declares the commands of the robot and their categories.",
    states: """
    Declares the states in which an armed robot can be, beside `:idle`.

    `initial_state` is the state after the robot is armed (`:idle`).
    """,
    topology: "Declares the links and joints of the robot, a tree with one root link.",
    simulation: """
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
    """,
    link: """
    Declares a link, a rigid part of the robot: `link :base_link do … end`, or `link :arm` when
    the link carries nothing.

    A link without a name is called `:link_0`, `:link_1`, …
    """,
    joint: """
    Declares a joint, which connects the link around it with the link inside it.

    `type` is one of `:revolute`, `:continuous`, `:prismatic`, `:planar`, `:floating` and
    `:fixed`. A joint without a name is called `:joint_0`, `:joint_1`, …
    """,
    origin: """
    Sets a place and an orientation in the frame around it: of a joint or a shape in its link, or
    of a link's centre of mass. `x`, `y`, `z` are lengths; `roll`, `pitch`, `yaw` are angles about
    the fixed axes x, y and z, in this order, as in URDF.
    """,
    axis: """
    Sets the direction about which a joint turns or along which it slides; for a planar joint the
    normal of its plane.

    The direction is z, turned by the angles `roll`, `pitch` and `yaw`. Or give it as numbers
    `x`, `y`, `z`: `axis y: 1`.
    """,
    limit: """
    Sets the limits of a joint: `lower` and `upper` (angles, or lengths of a prismatic joint),
    `effort` (torque or force), `velocity`, and `acceleration`.
    """,
    dynamics: """
    Sets what resists the movement of a joint: `damping` and `friction`, as quantities or as
    numbers in SI units.
    """,
    inertial: "Declares the mass of a link, its centre of mass and its inertia.",
    inertia: "Sets the inertia of a link about its centre of mass.",
    visual: "Declares what a link looks like: one shape, a material and its origin.",
    collision: """
    Declares a shape that stands for the link where collisions are computed.

    A collision without a name is called `:collision_0`, `:collision_1`, …
    """,
    box: "Sets a box as the shape, by the lengths of its sides.",
    cylinder: "Sets a cylinder along the z axis as the shape.",
    sphere: "Sets a sphere as the shape.",
    capsule: """
    Sets a capsule along the z axis as the shape: a cylinder of `height` with a half sphere at
    each end.
    """,
    mesh: "Sets a shape in a file as the shape, `scale` times as large.",
    material: """
    Declares the material of a visual.

    A material without a name is called `:material_0`, `:material_1`, …
    """,
    color: "Sets the color of a material. Its parts are numbers from 0 to 1.",
    texture: "Sets the texture of a material, a picture in a file.",
    sensor: """
    Declares a sensor: `sensor :imu, {BB.Sensor.Mpu6050, bus: "i2c-1"}`, or the module alone when
    it needs no options.

      * `required` - whether the robot is useless without the sensor (`false`)
      * `retain` - whether the pubsub retains its last message for late subscribers (`false`)
      * `max_silence` - the longest time between two messages that the sensor publishes or carries
        elsewhere; a sensor that is silent for longer is `:stale`
    """,
    actuator: """
    Declares an actuator of a joint: `actuator :servo, {MyRobot.Servo, channel: 0}`.

      * `required` - whether the robot is useless without the actuator (`false`)
    """,
    controller: """
    Declares a controller of the robot.

        controller :balance, {MyRobot.Balance, gain: param([:balance, :gain])}

      * `required` - whether the robot is useless without the controller (`false`)
      * `simulation` - what runs in a simulation: nothing (`:omit`), a mock (`:mock`), or the
        controller itself (`:start`)
    """,
    transmission: """
    Declares the transmission between a joint and its sensor or actuator (`BB.Transmission`).
    """,
    estimator: """
    Declares an estimator, of the sensor around it or of several inputs.

        estimator :pose, {MyRobot.Pose, []} do
          input :imu, [:sensor, :base_link, :imu], driver?: true
          input :gps, [:sensor, :base_link, :gps]
          sync_tolerance ~u(20 millisecond)
        end
    """,
    input: "Declares an input of an estimator: a name, and the path of a sensor or an estimator.",
    output: "Declares an output of an estimator, on a path of its own if it has one.",
    param: """
    Declares a parameter.

        param :rate, type: {:unit, :hertz}, default: ~u(100 hertz), min: ~u(1 hertz)

    `type` is one of `BB.Parameter.Type`. A parameter without a default has no value until it is
    set.
    """,
    group: """
    Declares a group of parameters and of other groups. The group's name stands in their paths
    before their own names.
    """,
    bridge: """
    Declares a bridge to the parameters of another device. `simulation` says what runs in a
    simulation: nothing (`:omit`), a mock (`:mock`), or the bridge itself (`:start`).
    """,
    command: """
    Declares a command.

        command :home, handler: MyRobot.Home do
          allowed_states [:idle]
          timeout 10_000
          argument :speed, :float, default: 0.5
        end
    """,
    argument: "Declares an argument of a command: its name and its type.",
    category: "Declares a category of commands, of which so many may run at the same time.",
    state: "Declares a state in which an armed robot can be.",
    i2c: """
    Declares a simulated I2C bus: `i2c "i2c-1", clock_hz: 400_000 do … end`.

    `clock_hz` is the clock of the bus; without a clock transfers take no time
    (`t:BB.Bus.Sim.bus_options/0`).
    """,
    gpio: """
    Declares a simulated chip of GPIO lines: `gpio "gpiochip0" do … end`. Its fields are those of
    `t:BB.Bus.Sim.Lines.chip_options/0`.
    """,
    device: """
    Declares a simulated device.

    On an I2C bus the device has an address (`BB.Bus.Sim.Device`), on GPIO lines it has a name
    (`BB.Bus.Sim.GPIO.Device`):

        device 0x68, {BB.Bus.Sim.Mpu6050, source: :motion}
        device :bumper, {BB.Bus.Sim.Contact, pins: [contact: 17]}
    """
  }

  @doc "Returns the documentation of an entity's word."
  @spec text(atom()) :: String.t()
  def text(kind) do
    [String.trim_trailing(Map.fetch!(@texts, kind)), listed(kind)]
    |> Enum.reject(&(&1 == nil))
    |> Enum.join("\n\n")
  end

  defp listed(kind) do
    case {Grammar.field_words(kind), Grammar.entities(kind)} do
      {[], []} -> nil
      {fields, []} -> "Fields: #{words(fields)}."
      {[], entities} -> "Inside: #{words(entities)}."
      {fields, entities} -> "Fields: #{words(fields)}. Inside: #{words(entities)}."
    end
  end

  defp words(words), do: Enum.map_join(words, ", ", &"`#{&1}`")
end

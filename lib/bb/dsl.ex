defmodule BB.Dsl do
  @moduledoc """
  The language in which a robot is declared. `use BB` imports it into a robot's module.

      defmodule MyRobot do
        use BB

        settings do
          name :my_robot
        end

        parameters do
          param :debug, type: :boolean, default: false

          group :imu do
            param :rate, type: {:unit, :hertz}, default: ~u(100 hertz), max: ~u(1 kilohertz)
          end
        end

        sensors do
          sensor :battery, {BB.Sensor.Ina219, bus: "i2c-1", address: 0x40}
        end

        controllers do
          controller :balance, {MyRobot.Balance, verbose: param([:debug])}
        end

        topology do
          link :base_link do
            sensor :imu, {BB.Sensor.Mpu6050, bus: "i2c-1", rate: param([:imu, :rate])},
              max_silence: ~u(100 millisecond)

            joint :shoulder do
              type :revolute
              origin z: ~u(0.1 meter)

              limit lower: ~u(-90 degree),
                    upper: ~u(90 degree),
                    effort: ~u(10 newton_meter),
                    velocity: ~u(60 degree_per_second)

              actuator :servo, {MyRobot.Servo, channel: 0} do
                transmission reduction: 3.0
              end

              link :arm
            end
          end
        end

        simulation do
          i2c "i2c-1" do
            device 0x40, {BB.Bus.Sim.Ina219, source: [voltage: 11.1, current: 1.5]}
            device 0x68, {BB.Bus.Sim.Mpu6050, source: :motion}
          end
        end
      end

  Every entity can be written with or without parentheses, as a block or as keywords.
  `BB.Dsl.Robot` documents the sections, `BB.Dsl.Words` the words inside them. A mistake raises
  `BB.Dsl.Error` when the module is compiled. What is only probably a mistake is a warning.

  `MyRobot.robot()` returns the declaration in SI units (`BB.Robot`), and `BB.Dsl.Info` returns it
  as it is written.

  Put `import_deps: [:ganglion]` into `.formatter.exs`, so that `mix format` adds no parentheses.
  """

  alias BB.Parameter.Schema

  defmacro __before_compile__(env) do
    declaration = BB.Dsl.Compiler.declaration(BB.Dsl.Builder.finish(env.module))
    robot = BB.Robot.Builder.build(env.module, declaration)
    commands = for %BB.Dsl.Command{} = command <- declaration.commands, do: command
    Module.put_attribute(env.module, :bb_commands, commands)

    quote do
      @doc "Returns the description of the robot in SI units, a `BB.Robot`."
      @spec robot() :: BB.Robot.t()
      def robot, do: unquote(Macro.escape(robot))

      @doc false
      @spec __bb_parameter_schema__() :: BB.Parameter.Schema.flat()
      def __bb_parameter_schema__,
        do: unquote(Macro.escape(Schema.of_definitions(robot.parameters)))

      @doc false
      @spec __bb_default_parameters__() :: [{BB.Parameter.path(), term()}]
      def __bb_default_parameters__, do: unquote(Macro.escape(Schema.defaults(robot.parameters)))

      @doc false
      def __bb_declaration__, do: unquote(Macro.escape(declaration))

      @doc false
      def __bb_states__, do: BB.Dsl.Info.states(__MODULE__)

      @doc false
      def __bb_state_names__, do: BB.Dsl.Info.state_names(__MODULE__)

      @doc false
      def __bb_initial_state__, do: BB.Dsl.Info.initial_state(__MODULE__)

      @doc false
      def __bb_categories__, do: BB.Dsl.Info.categories(__MODULE__)

      @doc false
      def __bb_category_limits__, do: BB.Dsl.Info.category_limits(__MODULE__)

      @doc false
      def __bb_arm_command__, do: BB.Dsl.Info.arm_command(__MODULE__)

      @doc false
      def __bb_disarm_command__, do: BB.Dsl.Info.disarm_command(__MODULE__)
    end
  end
end

defmodule BB.Dsl do
  @moduledoc """
  How a robot is declared.

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
              limit lower: ~u(-90 degree), upper: ~u(90 degree), effort: ~u(10 newton_meter)

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

  Every entity works with and without parentheses, as a block or as keywords. The sections are described in
  `BB.Dsl.Robot`, what stands in them in `BB.Dsl.Component`, `BB.Dsl.Words.Topology`, `BB.Dsl.Words.Link`, `BB.Dsl.Words.Joint`,
  `BB.Dsl.Words.Parameters` and `BB.Dsl.Simulation`. A mistake raises `BB.Dsl.Error` while the module compiles.

  For `mix format` to leave the words without parentheses, put `import_deps: [:ganglion]` into `.formatter.exs`.
  """

  defmacro __before_compile__(env) do
    robot = BB.Dsl.Compiler.robot(env.module, BB.Dsl.Builder.finish(env.module))

    quote do
      @doc "The robot as declared: a `BB.Robot`."
      @spec robot() :: BB.Robot.t()
      def robot, do: unquote(Macro.escape(robot))
    end
  end
end

# A robot with differential drive, in keywords and parentheses.
defmodule BB.Test.BeamBots.Rover do
  use BB
  import BB.Unit

  alias BB.Test.BeamBots.{Mixer, Motor, Ticker}

  @wheel_radius ~u(35 millimeter)
  @frequency ~u(200 hertz)

  settings do
    name(:rover)
    registry_options([])
  end

  sensors do
    sensor(:battery, {Ticker, rate: ~u(20 hertz)})
  end

  sensors do
    sensor :supply, Ticker
  end

  controllers do
    controller(:mixer, {Mixer, bus: "/dev/ttyAMA0"}, simulation: :mock)
  end

  topology do
    link :chassis do
      inertial do
        mass(~u(1200 gram))
      end

      visual do
        box(x: ~u(20 centimeter), y: ~u(15 centimeter), z: ~u(50 millimeter))
        material(name: :red, do: color(red: 1, green: 0, blue: 0))
      end

      sensor(:imu, {Ticker, rate: @frequency, address: 0x68})

      joint :left, type: :continuous do
        origin(x: ~u(0 meter), y: ~u(8 centimeter), z: ~u(0 meter))
        axis(roll: ~u(-90 degree))
        limit(effort: ~u(1 newton_meter), velocity: ~u(360 degree_per_second))
        actuator(:left_motor, {Motor, channel: 0, frequency: @frequency})

        link :left_wheel do
          collision do
            cylinder(radius: @wheel_radius, height: ~u(2 centimeter))
          end
        end
      end

      joint(:right, type: :continuous) do
        origin(y: ~u(-8 centimeter))
        axis(roll: ~u(-90 degree))
        limit(effort: ~u(1 newton_meter), velocity: ~u(360 degree_per_second))

        actuator(:right_motor, {Motor, channel: 1, frequency: @frequency}) do
          transmission(reversed?: true, reduction: 2)
        end

        link(:right_wheel)
      end

      joint :caster do
        type :fixed
        link :caster_wheel
      end
    end
  end

  @doc "The wheels' radius, with the unit of the module."
  def wheel_radius, do: BB.Unit.convert!(~u(3.5centimeter), "meter")
end

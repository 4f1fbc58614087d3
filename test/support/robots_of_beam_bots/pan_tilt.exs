# A camera on two servos without feedback, with links and joints that have no name.
defmodule BB.Test.BeamBots.PanTilt do
  use BB
  import BB.Unit
  import BB.Unit.Option, only: []

  topology do
    link do
      joint :pan, type: :revolute do
        limit lower: ~u(-90 degree),
              upper: ~u(90 degree),
              effort: ~u(0.2 newton_meter),
              velocity: ~u(300 degree_per_second)

        actuator :pan_servo, {BB.Test.BeamBots.Servo, pin: 17}

        sensor :pan_estimator, {BB.Sensor.OpenLoopPositionEstimator, actuator: :pan_servo}

        link do
          joint :tilt do
            type :revolute

            limit do
              lower ~u(-45 degree)
              upper ~u(45 degree)
              effort ~u(0.2 newton_meter)
              velocity ~u(300 degree_per_second)
            end

            axis do
              pitch ~u(90 degree)
            end

            actuator :tilt_servo, {BB.Test.BeamBots.Servo, pin: 18} do
              transmission reversed?: true
            end

            sensor(
              :tilt_estimator,
              {BB.Sensor.OpenLoopPositionEstimator,
               actuator: :tilt_servo,
               easing: :ease_in_out_quad,
               publish_rate: ~u(100 hertz),
               max_silence: ~u(2 second)}
            )

            link do
              joint do
                type :fixed
                link :camera
              end

              joint(type: :fixed, do: link(:lamp))
            end
          end
        end
      end
    end
  end
end

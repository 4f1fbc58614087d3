# A leg of a quadruped. Two joints follow others by a linkage, which mimic sensors compute.
defmodule BB.Test.BeamBots.Leg do
  use BB

  alias BB.Test.BeamBots.Encoder

  topology do
    link :hip do
      joint :knee do
        type :revolute

        limit lower: ~u(-30 degree),
              upper: ~u(120 degree),
              effort: ~u(5 newton_meter),
              velocity: ~u(180 degree_per_second)

        sensor :knee_encoder, Encoder
        sensor :knee_spare, Encoder
        link :shin
      end

      joint :rod do
        type :revolute
        limit effort: ~u(5 newton_meter), velocity: ~u(180 degree_per_second)
        sensor :rod_mimic, {BB.Sensor.Mimic, source: :knee, multiplier: -1.0}
        link :rod_link
      end

      joint :ankle do
        type :revolute
        limit effort: ~u(5 newton_meter), velocity: ~u(180 degree_per_second)

        sensor :ankle_mimic,
               {BB.Sensor.Mimic,
                source: :knee,
                multiplier: 0.5,
                offset: 0.25,
                message_types: [BB.Message.Sensor.JointState]}

        link :foot do
          nil
        end
      end
    end
  end
end

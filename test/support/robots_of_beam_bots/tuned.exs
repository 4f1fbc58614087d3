# A robot whose description refers to parameters, which a store keeps.
defmodule BB.Test.BeamBots.Tuned do
  use BB

  alias BB.Test.BeamBots.{Motor, Ticker}

  settings do
    parameter_store {BB.Parameter.Store.Dets, path: Path.join(System.tmp_dir!(), "bb_tuned.dets")}
    topology_max_restarts 10
    topology_max_seconds 60
  end

  parameters do
    param :rate,
      type: {:unit, :hertz},
      default: ~u(50 hertz),
      min: ~u(1 hertz),
      max: ~u(1 kilohertz)

    param :label, type: :string
    param :pin, type: {:or, [:non_neg_integer, nil]}
    param :mode, type: {:in, [:slow, :fast]}, default: :slow, doc: "How fast."

    group :motion do
      doc "What limits its motions."

      param :top do
        type {:unit, :degree}
        default ~u(90 degree)
        min ~u(0 degree)
        max ~u(180 degree)
      end

      param :speed, type: {:unit, :degree_per_second}, default: ~u(60 degree_per_second)

      param :damping,
        type: {:unit, :newton_meter_second_per_radian},
        default: ~u(1 newton_meter_second_per_radian)

      group :gear do
        param :ratio, type: :float, default: 4.0, min: 1.0, max: 100.0
        param :reversed, type: :boolean, default: false
        param :zero, type: {:unit, :degree}, default: ~u(10 degree)
      end
    end

    group :body, doc: "Its masses." do
      param :mass, type: {:unit, :kilogram}, default: ~u(2 kilogram)
      param :height, type: {:unit, :meter}, default: ~u(0.5 meter)
      param :tilt, type: {:unit, :degree}, default: ~u(90 degree)
    end
  end

  sensors do
    sensor :gauge, {Ticker, rate: param([:rate])}
  end

  topology do
    link :base do
      inertial do
        mass param([:body, :mass])
      end

      joint :mast do
        type :revolute

        origin z: param([:body, :height]), roll: ~u(5 degree)
        axis pitch: param([:body, :tilt])

        limit do
          lower ~u(-10 degree)
          upper param([:motion, :top])
          effort ~u(10 newton_meter)
          velocity param([:motion, :speed])
        end

        dynamics damping: param([:motion, :damping])

        actuator :mast_motor, {Motor, channel: 3, frequency: param([:rate])} do
          transmission do
            reduction param([:motion, :gear, :ratio])
            offset param([:motion, :gear, :zero])
            reversed? param([:motion, :gear, :reversed])
          end
        end

        link :top
      end
    end
  end
end

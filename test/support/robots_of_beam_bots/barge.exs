# A barge that floats, and a tender that drives over its deck, with controllers and a bridge.
defmodule BB.Test.BeamBots.Barge do
  use BB

  alias BB.Test.BeamBots.{Matcher, Motor, Ticker}

  parameters do
    bridge :shore, {BB.Test.BeamBots.Shore, port: 5760}, simulation: :mock
    param :depth, type: :float, default: 1.5
  end

  sensors do
    sensor :power, {Ticker, []}
  end

  controllers do
    controller :watch,
               {BB.Controller.PatternMatch,
                topic: [:sensor, :power],
                match: &Matcher.high?/1,
                action: handle_event(&Matcher.handle/2),
                cooldown_ms: 0}

    controller :low,
               {BB.Controller.Threshold,
                topic: [:sensor, :power],
                field: :voltage,
                min: 13.0,
                action: handle_event(&Matcher.handle/2)} do
      simulation :start
    end

    controller(
      :never,
      {BB.Controller.Threshold,
       topic: [:sensor, :power], field: [:voltage], max: 99.0, action: command(:disarm)}
    )

    controller :orders,
               {BB.Controller.PatternMatch,
                topic: [:order], match: &Matcher.high?/1, action: command(:go, speed: 1.0)}
  end

  topology do
    link :world do
      joint :float do
        type :floating

        link :hull do
          joint :deck do
            type :planar

            axis do
            end

            limit effort: ~u(10 newton), velocity: ~u(1 meter_per_second)
            dynamics damping: ~u(2 newton_second_per_meter), friction: ~u(1 newton)
            actuator :tug, {Motor, channel: 0}
            link :tender
          end
        end
      end
    end
  end
end

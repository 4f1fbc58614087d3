# A robot with every word of the DSL (BB.Dsl.Grammar). BB.Dsl.EveryWordTest compiles it, and holds
# that no word is missing here. The modules BB.Test.Nowhere.* do not exist.
defmodule BB.Test.EveryWord do
  use BB

  settings do
    name :every_word
    topic_prefix "every"
    parameter_store nil
    registry_module Registry
    registry_options partitions: 1
    supervisor_module Supervisor
    topology_max_restarts 5
    topology_max_seconds 10
  end

  parameters do
    param :debug, type: :boolean, default: false, doc: "Whether to log."

    group :arm, doc: "The arm." do
      param :gear do
        type :float
        default 2.0
        min 0.5
        max 10.0
        doc "Motor turns per joint turn."
      end

      group :reach do
        doc "How far it reaches."
        param :height, type: {:unit, :meter}, default: ~u(10 centimeter)
      end
    end

    bridge :remote, {BB.Test.Nowhere.Bridge, []}, simulation: :mock
  end

  # Sections of one kind add up.
  parameters do
    param :top, type: {:unit, :degree}, default: ~u(90 degree)
  end

  sensors do
    sensor :battery, BB.Test.Probe do
      required true
      retain true
      max_silence ~u(1 second)

      estimator :charge, BB.Test.Nowhere.Charge do
        latency_budget ~u(10 millisecond)
        lost_after ~u(1 second)
        recover_after 3
        on_degraded :stop
        on_lost :stop
        on_recovered :home
      end
    end
  end

  controllers do
    controller :balance, {BB.Test.Brain, rate: 1}, simulation: :start

    controller :other, BB.Test.Brain do
      required true
      simulation :omit
    end
  end

  commands do
    category :motion do
      doc "What moves."
      concurrency_limit 2
    end

    command :arm do
      handler BB.Test.Nowhere.Arm
      allowed_states :disarmed
      arm true
    end

    command :stop, handler: {BB.Test.Nowhere.Stop, []}, allowed_states: :* do
      cancel :*
      disarm true
    end

    command :home do
      handler BB.Test.Nowhere.Home
      timeout 5_000
      category :motion
      cancel [:motion]
      allowed_states [:idle, :working]

      argument :speed, :float do
        required false
        default 0.5
        doc "From 0 to 1."
      end

      argument :mode, type: {:in, [:slow, :fast]}, required: true
    end
  end

  states do
    initial_state :working

    state :working do
      doc "Doing its work."
    end
  end

  topology do
    link :base do
      inertial do
        mass ~u(2500 gram)

        origin do
          x ~u(1 centimeter)
          y ~u(-2 centimeter)
          z ~u(30 millimeter)
        end

        inertia do
          ixx ~u(0.1 kilogram_square_meter)
          iyy ~u(0.2 kilogram_square_meter)
          izz ~u(0.3 kilogram_square_meter)
          ixy ~u(0.01 kilogram_square_meter)
          ixz ~u(0.02 kilogram_square_meter)
          iyz ~u(0.03 kilogram_square_meter)
        end
      end

      visual do
        box x: ~u(40 centimeter), y: ~u(0.3 meter), z: ~u(100 millimeter)
        origin z: ~u(5 centimeter), yaw: ~u(180 degree)

        material do
          name :grey
          color red: 0.5, green: 0.5, blue: 0.5, alpha: 0.9
          texture filename: "steel.png"
        end
      end

      collision do
        name :hull

        cylinder do
          radius ~u(20 centimeter)
          height ~u(10 centimeter)
        end
      end

      collision :dome do
        sphere radius: ~u(0.2 meter)
        origin z: ~u(0.1 meter)
      end

      collision do
        capsule do
          radius ~u(5 centimeter)
          height ~u(20 centimeter)
        end
      end

      sensor :imu, BB.Test.Probe
      sensor :gps, {BB.Test.Probe, []}

      estimator :pose, BB.Test.Nowhere.Pose do
        input :imu, [:sensor, :base, :imu], driver?: true

        input :gps do
          path [:sensor, :base, :gps]
          driver? false
        end

        output :out

        output :fast do
          path [:fast_pose]
        end

        sync_tolerance ~u(20 millisecond)
      end

      joint :shoulder do
        type :revolute

        origin do
          x ~u(1 meter)
          y ~u(2 meter)
          z param([:arm, :reach, :height])
          roll ~u(10 degree)
          pitch ~u(20 degree)
          yaw ~u(30 degree)
        end

        axis do
          roll ~u(-90 degree)
          pitch ~u(0 degree)
          yaw ~u(0 degree)
        end

        limit do
          lower ~u(-90 degree)
          upper param([:top])
          effort ~u(10 newton_meter)
          velocity ~u(60 degree_per_second)
          acceleration ~u(180 degree_per_square_second)
        end

        dynamics do
          damping ~u(1 newton_meter_second_per_degree)
          friction ~u(0.5 newton_meter)
        end

        sensor :encoder, BB.Test.Probe do
          transmission do
            reduction param([:arm, :gear])
            offset ~u(90 degree)
            reversed? true
          end
        end

        actuator :motor, {BB.Test.Motor, rate: 1} do
          required true
          transmission reduction: -3
        end

        link :upper do
          visual do
            mesh filename: "upper.stl", scale: 2
          end

          joint :slide, type: :prismatic do
            limit lower: ~u(0 meter),
                  upper: ~u(50 centimeter),
                  effort: ~u(20 newton),
                  velocity: ~u(0.1 meter_per_second),
                  acceleration: ~u(1 meter_per_square_second)

            dynamics damping: ~u(3 newton_second_per_meter), friction: ~u(1 newton)
            axis x: 3, y: 0, z: 4
            link :finger
          end

          joint do
            type :continuous
            link
          end

          joint :plane do
            type :planar

            axis do
            end

            limit effort: ~u(1 newton), velocity: ~u(1 meter_per_second)

            link :cart do
              nil
            end
          end

          joint(:free, [type: :floating], do: link(:drone))

          joint :weld, type: :fixed do
            link :tip
          end
        end
      end
    end
  end

  simulation do
    i2c "i2c-every-word" do
      clock_hz 400_000
      device 0x68, {BB.Bus.Sim.Mpu6050, source: :motion}
    end

    gpio "gpio-every-word" do
      lines 8
      label "lines"
      labels %{1 => "one"}
      timestamp_offset_ns 0
      device :bumper, {BB.Bus.Sim.Contact, pins: [contact: 3]}
    end
  end
end

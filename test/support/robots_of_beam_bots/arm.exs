# An arm of six joints with shapes, commands and states, in blocks.
defmodule BB.Test.BeamBots.Arm do
  use BB

  alias BB.Test.BeamBots.{Encoder, Motor}

  states do
    initial_state :idle

    state :homing do
      doc "Drives to its stops."
    end

    state :parked, doc: "Folded."
    state(:disarmed)
  end

  commands do
    category :motion do
      doc "What moves joints."
      concurrency_limit 1
    end

    category(:sensing, concurrency_limit: 3)

    command :arm do
      handler BB.Command.Arm
      allowed_states [:disarmed]
    end

    command :disarm do
      handler BB.Command.Disarm
      allowed_states :*
      cancel :*
    end

    command :park, handler: {BB.Command.SetState, to: :parked}, category: :motion

    command :reach do
      handler {BB.Command.MoveTo, max_iterations: 50}
      timeout 5_000
      allowed_states [:idle, :parked]
      category :motion
      cancel [:sensing]

      argument :speed, :float do
        default 0.5
        doc "From 0 to 1."
      end

      argument :mode, {:in, [:fast, :slow]}, required: true
      argument(:target, :string, doc: "A name.")
    end
  end

  topology do
    link :base do
      inertial do
        mass ~u(4 kilogram)

        origin do
          z ~u(5 centimeter)
        end

        inertia do
          ixx ~u(0.02 kilogram_square_meter)
          iyy ~u(0.02 kilogram_square_meter)
          izz ~u(0.03 kilogram_square_meter)
          ixy ~u(0 kilogram_square_meter)
          ixz ~u(0 kilogram_square_meter)
          iyz ~u(0 kilogram_square_meter)
        end
      end

      visual do
        origin do
          z ~u(5 centimeter)
        end

        cylinder do
          radius ~u(8 centimeter)
          height ~u(10 centimeter)
        end

        material do
          name :black

          color do
            red 0.1
            green 0.1
            blue 0.1
            alpha 1.0
          end
        end
      end

      collision do
        cylinder do
          radius ~u(9 centimeter)
          height ~u(11 centimeter)
        end

        origin do
          z ~u(55 millimeter)
        end
      end

      joint :waist do
        type :revolute

        origin do
          z ~u(10 centimeter)
        end

        axis do
        end

        limit do
          lower ~u(-180 degree)
          upper ~u(180 degree)
          effort ~u(30 newton_meter)
          velocity ~u(90 degree_per_second)
          acceleration ~u(360 degree_per_square_second)
        end

        dynamics do
          damping ~u(1 newton_meter_second_per_radian)
          friction ~u(0.1 newton_meter)
        end

        actuator :waist_motor, {Motor, channel: 0} do
          transmission do
            reduction 50.0
            offset ~u(90 degree)
            reversed? true
          end
        end

        link :turret do
          visual do
            mesh do
              filename "turret.stl"
              scale 0.001
            end
          end

          joint :shoulder do
            type :revolute

            axis do
              roll ~u(-90 degree)
            end

            limit do
              lower ~u(-90 degree)
              upper ~u(90 degree)
              effort ~u(20 newton_meter)
              velocity ~u(1 radian_per_second)
            end

            actuator :shoulder_left, {Motor, channel: 1}

            actuator :shoulder_right, {Motor, channel: 2} do
              transmission do
                reduction -1.0
              end
            end

            link :upper_arm do
              visual do
                capsule do
                  radius ~u(4 centimeter)
                  height ~u(30 centimeter)
                end

                material do
                  texture do
                    filename "steel.png"
                  end
                end
              end

              joint :elbow do
                type :revolute

                origin do
                  z ~u(30 centimeter)
                  pitch ~u(90 degree)
                end

                axis do
                  pitch ~u(90 degree)
                end

                limit do
                  lower ~u(0 degree)
                  upper ~u(150 degree)
                  effort ~u(10 newton_meter)
                  velocity ~u(60 degree_per_second)
                end

                actuator :elbow_motor, {Motor, channel: 3}
                sensor :elbow_encoder, Encoder

                link :forearm do
                  collision do
                    name :sleeve

                    box do
                      x ~u(5 centimeter)
                      y ~u(5 centimeter)
                      z ~u(25 centimeter)
                    end
                  end

                  collision :knob do
                    sphere do
                      radius ~u(3 centimeter)
                    end
                  end

                  joint :roll do
                    type :continuous
                    actuator :roll_motor, {Motor, channel: 4}

                    link :wrist do
                      joint :bend do
                        type :revolute

                        limit do
                          effort ~u(2 newton_meter)
                          velocity ~u(60 degree_per_second)
                        end

                        actuator :bend_motor, {Motor, channel: 5}

                        link :hand do
                          joint :grip do
                            type :prismatic

                            limit do
                              lower ~u(0 millimeter)
                              upper ~u(40 millimeter)
                              effort ~u(20 newton)
                              velocity ~u(10 centimeter_per_second)
                              acceleration ~u(1 meter_per_square_second)
                            end

                            dynamics do
                              damping ~u(3 newton_second_per_meter)
                            end

                            actuator :grip_motor, {Motor, channel: 6} do
                              transmission offset: ~u(10 millimeter)
                            end

                            link :finger do
                            end
                          end
                        end
                      end
                    end
                  end
                end
              end
            end
          end
        end
      end
    end
  end
end

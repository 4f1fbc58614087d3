defmodule BB.Dsl.MistakesTest do
  # Captures the output of all processes on stderr.
  use ExUnit.Case, async: false

  import BB.Test.Mistake
  import BB.Test.Robot
  import ExUnit.CaptureIO

  @turning "effort: ~u(1 newton_meter), velocity: ~u(1 radian_per_second)"
  @sliding "effort: ~u(1 newton), velocity: ~u(1 meter_per_second)"

  # The reason for which a joint of a type is refused.
  defp joint(type, inside) do
    mistake("""
    topology do
      link :base do
        joint :j do
          type #{inspect(type)}
          #{inside}
          link :tip
        end
      end
    end
    """).reason
  end

  defp limit(type) when type in [:revolute, :continuous], do: "limit #{@turning}"
  defp limit(type) when type in [:prismatic, :planar], do: "limit #{@sliding}"

  describe "a joint" do
    test "has the limits, the axis and the dynamics of its type" do
      for type <- [:revolute, :prismatic],
          do: assert(joint(type, "") =~ "Limits must be present for #{type} joints")

      assert joint(:planar, "") =~ "An axis must be present for planar joints"
      assert joint(:planar, "") =~ "surface normal"
      assert joint(:fixed, "axis x: 1") =~ "Cannot set an axis when parent joint is fixed"
      floating = joint(:floating, "axis x: 1")
      assert floating =~ "Cannot set an axis when parent joint is floating"
      assert floating =~ ":planar"

      for type <- [:fixed, :floating] do
        assert joint(type, "dynamics damping: 0.1") =~
                 "Joint dynamics cannot be provided for #{type} joints"

        assert joint(type, "limit #{@turning}") =~ "Limits cannot be set for #{type} joints"
      end

      for {type, unit} <- [continuous: "degree", planar: "meter"], field <- ["lower", "upper"] do
        inside = "#{limit(type)}, #{field}: ~u(1 #{unit})"
        inside = if type == :planar, do: "axis do\nend\n" <> inside, else: inside
        assert joint(type, inside) =~ "#{field} cannot be set for #{type} joints"
      end
    end

    test "has effort and velocity in its limit" do
      assert joint(:revolute, "limit velocity: ~u(1 radian_per_second)") =~
               "limit has no effort; add `effort` to it"

      assert joint(:revolute, "limit effort: ~u(1 newton_meter)") =~ "limit has no velocity"
    end

    test "has the units of its movement" do
      for {type, fields, words} <- [
            {:revolute, "lower: ~u(1 meter), #{@turning}", "degree"},
            {:revolute, "upper: ~u(1 meter), #{@turning}", "degree"},
            {:revolute, "effort: ~u(1 newton), velocity: ~u(1 radian_per_second)",
             "newton meter"},
            {:revolute, "effort: ~u(1 newton_meter), velocity: ~u(1 meter_per_second)",
             "radian per second"},
            {:prismatic, "lower: ~u(1 degree), #{@sliding}", "meter"},
            {:prismatic, "effort: ~u(1 newton_meter), velocity: ~u(1 meter_per_second)",
             "newton"},
            {:prismatic, "effort: ~u(1 newton), velocity: ~u(1 radian_per_second)",
             "meter per second"}
          ] do
        reason = joint(type, "limit #{fields}")
        assert reason =~ ~r/Expected unit.*to be compatible with #{words}:/
        assert reason =~ "is not compatible with a `#{type}` joint"
      end

      for {type, fields, words} <- [
            {:revolute, "damping: ~u(1 newton_second_per_meter)", "newton meter second"},
            {:revolute, "friction: ~u(1 newton)", "newton meter"},
            {:prismatic, "damping: ~u(1 newton_meter_second_per_degree)",
             "newton second per meter"},
            {:prismatic, "friction: ~u(1 newton_meter)", "newton"}
          ] do
        reason = joint(type, "#{limit(type)}\ndynamics #{fields}")
        assert reason =~ ~r/Expected unit.*to be compatible with #{words}/
      end

      assert joint(:revolute, "limit acceleration: ~u(1 meter_per_square_second), #{@turning}") =~
               ~r/`meter-per-square-second`.*not compatible with a `revolute`/

      assert joint(:prismatic, "limit acceleration: ~u(1 degree_per_square_second), #{@sliding}") =~
               ~r/`degree-per-square-second`.*not compatible with a `prismatic`/
    end

    test "has an axis in one form, with a direction" do
      assert joint(:continuous, "axis x: 1, roll: ~u(1 degree)") =~ "either x, y, z or roll"
      assert joint(:continuous, "axis x: 0, y: 0") =~ "an axis needs a direction"
    end
  end

  describe "a link" do
    defp link(inside), do: mistake("topology do\n link :base do\n #{inside}\n end\nend").reason

    test "has one visual, with one shape" do
      assert link("visual sphere: [radius: ~u(1 meter)]\nvisual do\nend") =~
               "visual is given twice"

      assert link("visual do\n sphere radius: ~u(1 meter)\n mesh filename: \"x\"\nend") =~
               "mesh is a second shape of visual beside sphere"
    end

    test "has complete shapes, masses and inertias" do
      assert link("visual do\n box x: ~u(1 meter), y: ~u(1 meter)\nend") =~ "box has no z"
      assert link("collision do\n capsule radius: ~u(1 meter)\nend") =~ "capsule has no height"
      assert link("visual do\n mesh scale: 2\nend") =~ "mesh has no filename"
      assert link("inertial do\nend") =~ "inertial has no mass"
      assert link("inertial mass: ~u(1 meter)") =~ "expected a mass such as"

      assert link("inertial mass: ~u(1 gram), inertia: [ixx: ~u(1 kilogram_square_meter)]") =~
               "inertia has no iyy"
    end

    test "has colors from 0 to 1" do
      color = &link("visual do\n material do\n color red: #{&1}, green: 0, blue: 0\n end\n end")
      assert color.("1.1") =~ "Color value must be between 0 and 1"
      assert color.("\"red\"") =~ "Expected a number for color value"
    end

    test "follows no parameter with its shapes" do
      parameters = "parameters do\nparam :p, type: {:unit, :meter}, default: ~u(1 meter)\nend\n"

      assert mistake(
               parameters <>
                 "topology do\nlink :b do\nvisual do\norigin x: param([:p])\nend\nend\nend"
             ).reason =~ "an origin follows no parameter"
    end
  end

  describe "a name" do
    test "is unique over links, joints, components, materials and collisions" do
      for inside <- [
            "sensor :base, BB.Test.Probe",
            "joint :base, type: :fixed do\n link :tip\n end",
            "joint :j, type: :fixed do\n link :base\n end",
            "collision :base",
            "visual do\n material :base\n end",
            "collision do\n name :base\n end"
          ] do
        assert link(inside) =~ ~r/duplicate.*:base/s
      end
    end

    test "of a parameter, a command or a state may be any" do
      declared =
        robot do
          parameters do
            param :imu, type: :float

            group :left do
              param :gain, type: :float
            end

            group :right do
              param :gain, type: :float
            end
          end

          commands do
            command :imu, handler: BB.Test.Nowhere
          end

          states do
            state :imu
          end

          topology do
            link :base do
              sensor :imu, BB.Test.Probe
            end
          end
        end

      assert length(declared.robot().parameters) == 3
    end

    test "is made of the kind and the next free number" do
      declared =
        robot do
          topology do
            link do
              sensor nil, BB.Test.Probe
              collision do: sphere(radius: ~u(1 meter))

              joint :joint_0, type: :fixed do
                link do
                  joint do
                    type :fixed
                    link
                  end
                end
              end
            end
          end
        end

      assert Map.keys(declared.robot().links) == [:link_0, :link_1, :link_2]
      assert Map.keys(declared.robot().joints) == [:joint_0, :joint_1]
      assert Map.keys(declared.robot().sensors) == [:sensor_0]
      assert [%{name: :collision_0}] = declared.robot().links.link_0.collisions
    end
  end

  describe "a word that cannot stand where it stands" do
    test "is refused with the place and what may stand there" do
      error = mistake("topology do\n link :base do\n  senser :imu, BB.Test.Probe\n end\nend")
      assert error.path == [:topology, :base]
      assert error.line == 5
      assert error.reason =~ "a link has no :senser; it takes :name, :joint, :inertial"

      for {inside, reason} <- [
            {"axis z: 1", "axis cannot stand in a link; it belongs in a joint"},
            {"settings do\nend", "settings cannot stand in a link; it belongs in the robot"},
            {"input :x, [:sensor]", "input cannot stand in a link; it belongs in an estimator"},
            {"joint 1, 2, 3, 4", "joint has a wrong number of arguments"},
            {"wheels", "a link has no :wheels"},
            {"for _ <- 1..2 do\n wheel :left\n end", "a link has no :wheel"},
            {"if true do\n wheel :left\n else\n nil\n end", "a link has no :wheel"}
          ] do
        assert link(inside) =~ reason
      end

      assert joint(:fixed, "origin do\n  link :a\n end") =~ "link cannot stand in an origin"
    end

    test "harms nothing when it is an expression" do
      declared =
        robot do
          topology do
            link :base do
              nil
              side = :left
              _ = side
              IO.iodata_to_binary("text")
              to_string(side)

              case side do
                :left -> collision :left
                _ -> collision :right
              end

              side
            end
          end
        end

      assert [%{name: :left}] = declared.robot().links.base.collisions
      assert robot(do: topology(do: link(:a, do: nil))).robot().root_link == :a
    end

    test "clashes with no import of the robot's module" do
      declared =
        robot do
          import BB.Unit
          import BB.Parameter.Reference

          parameters do
            param :far, type: {:unit, :meter}, default: ~u(1 meter)
          end

          topology do
            link :base do
              joint :j, type: :fixed do
                origin x: param([:far]), y: new!(2, :meter)
                link :tip
              end
            end
          end
        end

      assert declared.robot().joints.j.origin.position == {nil, 2.0, 0.0}
    end

    test "clashes with neither name of references, nor with actions" do
      source = """
      defmodule BB.Dsl.MistakesTest.Importing do
        use BB
        import BB.Dsl.ParamRef
        import BB.Controller.Action

        parameters do
          group :arm do
            param :reach, type: {:unit, :meter}, default: ~u(1 meter)
          end
        end

        controllers do
          controller :guard,
                     {BB.Controller.Threshold,
                      topic: [:sensor], field: :voltage, min: 9.5, action: command(:rest, [])}
        end

        commands do
          command :rest do
            handler BB.Command.Disarm
          end
        end

        topology do
          link :base do
            joint :j, type: :fixed do
              origin x: param([:arm, :reach])
              link :tip
            end
          end
        end
      end
      """

      assert capture_io(:stderr, fn -> Code.compile_string(source) end) == ""
      robot = BB.Dsl.MistakesTest.Importing
      subscriptions = apply(robot, :robot, []).param_subscriptions
      assert subscriptions == %{[:arm, :reach] => [{:joint, :j, [:origin, :x]}]}
      assert [%BB.Dsl.Command{name: :rest}] = BB.Dsl.Info.commands(robot)
    end

    test "of an estimator in a sensor is an input" do
      capture_io(:stderr, fn ->
        error =
          mistake("""
          sensors do
            sensor :s, BB.Test.Probe do
              estimator :e, BB.Test.Nowhere do
                input :x, [:sensor, :s]
              end
            end
          end
          """)

        assert error.reason =~ "input cannot stand in an estimator of a sensor"
      end)
    end
  end

  describe "a robot" do
    test "may have joints alone, or no topology" do
      declared =
        robot do
          topology do
            joint :j, type: :fixed do
              link :a
            end
          end
        end

      assert %BB.Robot{root_link: nil, links: none} = declared.robot()
      assert none == %{}
      assert [%BB.Dsl.Joint{name: :j}] = BB.Dsl.Info.topology(declared)
    end

    test "has one root link, in several sections too" do
      assert mistake("topology do\n link :a\n end\n topology do\n link :b\n end").reason =~
               "There can only be one link at the root"
    end

    test "has a name of its own by default" do
      defmodule MostBasicRobot do
        use BB
      end

      alias BB.Dsl.Info
      assert Info.settings_name(MostBasicRobot) == {:ok, :most_basic_robot}
      assert Info.settings_name!(MostBasicRobot) == :most_basic_robot

      assert %{
               registry_module: Registry,
               supervisor_module: Supervisor,
               topology_max_restarts: 3,
               topology_max_seconds: 5,
               parameter_store: nil
             } = Info.settings(MostBasicRobot)

      partitions = System.schedulers_online()
      assert Info.settings_registry_options!(MostBasicRobot) == [partitions: partitions]
      assert MostBasicRobot.__bb_state_names__() == [:idle]
      assert [%BB.Dsl.State{name: :idle}] = MostBasicRobot.__bb_states__()
      assert [%BB.Dsl.Category{name: :default}] = MostBasicRobot.__bb_categories__()
      assert MostBasicRobot.__bb_category_limits__() == %{default: 1}
      assert MostBasicRobot.__bb_initial_state__() == :idle
      assert MostBasicRobot.__bb_arm_command__() == nil
      assert MostBasicRobot.__bb_disarm_command__() == nil
    end
  end
end

defmodule BB.DslTest do
  use ExUnit.Case, async: true

  import BB.Test.Mistake
  import ExUnit.CaptureIO
  import BB.Test.Robot
  import BB.Unit, only: :sigils

  alias BB.Dsl.{Grammar, Words}
  alias BB.Test.Probe

  doctest BB.Dsl.Child
  doctest BB.Dsl.Commands
  doctest BB.Dsl.Fields
  doctest BB.Dsl.Glossary
  doctest BB.Dsl.Grammar
  doctest BB.Dsl.Quantities
  doctest BB.Dsl.Rules
  doctest BB.Dsl.State
  doctest BB.Dsl.Words

  defmodule Judge do
    use BB.Sensor, options_schema: [answer: [type: :any]]

    @impl BB.Sensor
    def init(_opts), do: {:ok, nil}

    @impl BB.Sensor
    def max_silence(answer: :raise), do: raise("no idea")
    def max_silence(opts), do: opts[:answer]
  end

  describe "a declaration" do
    test "becomes a robot with links, joints and sensors" do
      robot =
        robot do
          settings do
            name :rover
          end

          sensors do
            sensor :battery, {BB.Test.Probe, rate: 1}
          end

          topology do
            link :base_link do
              sensor :imu, {BB.Test.Probe, rate: 100},
                required: true,
                max_silence: ~u(100 millisecond)

              joint :shoulder do
                type :revolute

                origin do
                  z(~u(0.1 meter))
                end

                axis do
                  z(1)
                end

                limit lower: ~u(-90 degree),
                      upper: ~u(90 degree),
                      effort: ~u(10 newton_meter),
                      velocity: ~u(60 degree_per_second)

                dynamics damping: 0.1
                sensor :encoder, BB.Test.Probe
                link :arm
              end
            end
          end
        end

      assert %BB.Robot{name: ^robot, root_link: :base_link} = declared = robot.robot()
      assert declared.settings == %{name: :rover}

      assert declared.sensors == %{
               battery: %{name: :battery, attached_to: :robot, transmission: nil},
               imu: %{name: :imu, attached_to: {:link, :base_link}, transmission: nil},
               encoder: %{name: :encoder, attached_to: {:joint, :shoulder}, transmission: nil}
             }

      assert {:ok, %{parent_joint: nil, child_joints: [:shoulder], sensors: [:imu]}} =
               BB.Robot.fetch_link(declared, :base_link)

      assert {:ok, %{parent_joint: :shoulder, child_joints: []}} =
               BB.Robot.fetch_link(declared, :arm)

      assert {:ok, joint} = BB.Robot.fetch_joint(declared, :shoulder)
      assert %{type: :revolute, parent_link: :base_link, child_link: :arm} = joint
      assert joint.origin == %{position: {0.0, 0.0, 0.1}, orientation: {0.0, 0.0, 0.0}}
      assert joint.axis == {0.0, 0.0, 1.0}
      assert_in_delta joint.limits.velocity, :math.pi() / 3, 1.0e-12
      assert joint.dynamics == %{damping: 0.1, friction: nil}
      assert joint.sensors == [:encoder]
    end

    test "places sensors at [name], [link…, name] and [link…, joint, name]" do
      robot =
        robot do
          sensors do
            sensor :battery, BB.Test.Probe
          end

          topology do
            link :base do
              sensor :imu, BB.Test.Probe

              joint :elbow do
                type :fixed
                sensor :encoder, BB.Test.Probe

                link :arm do
                  sensor :touch, BB.Test.Probe
                end
              end
            end
          end
        end

      paths = for component <- robot.robot().components, do: component.path

      assert paths == [
               [:battery],
               [:base, :imu],
               [:base, :elbow, :encoder],
               [:base, :elbow, :arm, :touch]
             ]
    end

    test "keeps a sensor's module, options and fields" do
      robot =
        robot do
          sensors do
            sensor :a, {BB.Test.Probe, rate: 5}, required: true, max_silence: ~u(0.5 second)

            sensor :b, BB.Test.Probe do
              retain true
              max_silence ~u(1 millisecond)
            end

            sensor :c, BB.Test.Probe, retain: true do
              required(true)
            end
          end
        end

      assert [
               %{module: Probe, options: [rate: 5], required: true, retain: false} = a,
               %{options: [], required: false, retain: true} = b,
               %{required: true, retain: true, max_silence_ns: nil}
             ] = robot.robot().components

      assert a.max_silence_ns == 500_000_000
      assert b.max_silence_ns == 1_000_000
    end

    test "means the same with and without parentheses, in blocks and in keywords" do
      blocks =
        robot do
          settings do
            name :one
          end

          topology do
            link :base do
              joint :j do
                type :prismatic

                limit do
                  lower ~u(0 meter)
                  upper ~u(1 meter)
                  effort ~u(1 newton)
                  velocity ~u(1 meter_per_second)
                end

                sensor :s, {BB.Test.Probe, rate: 5} do
                  required true
                end

                link :tip do
                end
              end
            end
          end
        end

      keywords =
        robot do
          settings(name: :one)

          topology do
            link(:base) do
              joint(:j,
                type: :prismatic,
                limit: [
                  lower: ~u(0 meter),
                  upper: ~u(1 meter),
                  effort: ~u(1 newton),
                  velocity: ~u(1 meter_per_second)
                ]
              ) do
                sensor(:s, {BB.Test.Probe, rate: 5}, required: true)
                link(:tip)
              end
            end
          end
        end

      assert %{blocks.robot() | name: nil} == %{keywords.robot() | name: nil}
    end

    test "means the same for every entity as a block, as keywords, and with parentheses" do
      blocks =
        robot do
          settings do
            name :one
            registry_options partitions: 2
          end

          parameters do
            param :rate do
              type :integer
              default 5
              min 1
              max 9
              doc "How often."
            end

            group :arm do
              param :gear, type: :float, default: 2.0
            end
          end

          sensors do
            sensor :battery, BB.Test.Probe do
              required true
              retain true
              max_silence ~u(1 second)
            end
          end

          controllers do
            controller :brain, BB.Test.Brain do
              required true
            end
          end

          topology do
            link :base do
              joint :j do
                type :revolute

                origin do
                  x ~u(1 meter)
                  yaw ~u(90 degree)
                end

                axis do
                  z 1
                end

                limit do
                  lower ~u(0 degree)
                  upper ~u(1 radian)
                  effort ~u(1 newton_meter)
                  velocity ~u(1 radian_per_second)
                end

                dynamics do
                  damping 0.1
                  friction 0.2
                end

                sensor :encoder, BB.Test.Probe do
                  transmission do
                    reduction param([:arm, :gear])
                    offset ~u(5 degree)
                    reversed? true
                  end
                end

                actuator :motor, {BB.Test.Motor, rate: param([:rate])} do
                  required true

                  transmission do
                    reduction 3
                  end
                end

                link :tip
              end
            end
          end
        end

      keywords =
        robot do
          settings(name: :one, registry_options: [partitions: 2])

          parameters do
            param(:rate, type: :integer, default: 5, min: 1, max: 9, doc: "How often.")
            group(:arm, do: param(:gear, do: [type(:float), default(2.0)]))
          end

          sensors(
            do:
              sensor(:battery, BB.Test.Probe,
                required: true,
                retain: true,
                max_silence: ~u(1 second)
              )
          )

          controllers(do: controller(:brain, {BB.Test.Brain, []}, required: true))

          topology do
            link(:base) do
              joint(:j,
                type: :revolute,
                origin: [x: ~u(1 meter), yaw: ~u(90 degree)],
                axis: [z: 1],
                limit: [
                  lower: ~u(0 degree),
                  upper: ~u(1 radian),
                  effort: ~u(1 newton_meter),
                  velocity: ~u(1 radian_per_second)
                ],
                dynamics: [damping: 0.1, friction: 0.2]
              ) do
                sensor(:encoder, BB.Test.Probe,
                  transmission: [
                    reduction: param([:arm, :gear]),
                    offset: ~u(5 degree),
                    reversed?: true
                  ]
                )

                actuator(:motor, {BB.Test.Motor, rate: param([:rate])}, required: true) do
                  transmission(reduction: 3)
                end

                link(:tip)
              end
            end
          end
        end

      assert %{blocks.robot() | name: nil} == %{keywords.robot() | name: nil}
      assert [_, _] = blocks.robot().parameters
      offsets = for {_, %{transmission: %{offset: _}}} <- blocks.robot().sensors, do: :given
      assert offsets == [:given]
    end

    test "names links and joints without a name :link_0, :joint_0, …" do
      robot =
        robot do
          topology do
            link do
              joint do
                type :fixed
                link()
              end

              joint type: :fixed do
                link :named
              end

              joint do
                type :continuous

                link do
                  sensor :s, BB.Test.Probe
                end
              end
            end
          end
        end

      declared = robot.robot()
      assert declared.root_link == :link_0
      assert Enum.sort(Map.keys(declared.links)) == [:link_0, :link_1, :link_2, :named]
      assert Enum.sort(Map.keys(declared.joints)) == [:joint_0, :joint_1, :joint_2]
      assert [%{path: [:link_0, :joint_2, :link_2, :s]}] = declared.components
    end

    test "is evaluated in the robot's module: expressions and comprehensions work" do
      robot =
        robot do
          @rate 7

          topology do
            link :base do
              for side <- [:left, :right] do
                joint :"#{side}_wheel" do
                  type :continuous
                  sensor :"#{side}_encoder", {BB.Test.Probe, rate: @rate}
                  link :"#{side}_tyre"
                end
              end
            end
          end
        end

      assert robot.robot().joints |> Map.keys() |> Enum.sort() == [:left_wheel, :right_wheel]
      assert [%{options: [rate: 7]}, %{options: [rate: 7]}] = robot.robot().components
    end

    test "does not clash with functions of the robot's module" do
      robot =
        robot do
          topology do
            link :base do
              joint :j do
                type :fixed
                origin x: ~u(1 meter)
                link :tip
              end
            end
          end

          def type(x), do: x
          def sensor(a, b), do: {a, b}
          def link(a), do: a
          def name(a), do: type(a)
          def x(a), do: link(a)
        end

      assert robot.x(1) == 1
      assert robot.name(2) == 2
    end

    test "may be empty" do
      robot =
        robot do
        end

      assert %BB.Robot{root_link: nil, components: []} = robot.robot()
    end
  end

  describe "a mistake is refused while the module compiles:" do
    test "two components of one name" do
      error =
        mistake("""
          sensors do
            sensor :imu, BB.Test.Probe
          end

          topology do
            link :base do
              sensor :imu, BB.Test.Probe
            end
          end
        """)

      assert error.path == [:topology, :base, :imu]
      assert error.line == 9

      assert Exception.message(error) =~
               "duplicate name :imu: sensor :imu has the name of a sensor, declared at lib/robot.ex:4; give each a name of its own"
    end

    test "a component so deep that its path would be too long" do
      error = mistake(chain(32))
      assert List.last(error.path) == :link_1

      assert error.reason ==
               "sensor :deep stands 64 levels deep, and the path of its messages would have more " <>
                 "than 64 segments; declare it further up"

      # One joint less is a robot.
      assert_raise ExUnit.AssertionError, fn -> mistake(chain(31)) end
    end

    # So many links, joined in a row, with a sensor on the last.
    defp chain(links) do
      inner = "link :link_1 do\nsensor :deep, BB.Test.Probe\nend"

      around = fn n, inside ->
        "link :link_#{n} do\njoint :joint_#{n} do\ntype :fixed\n#{inside}\nend\nend"
      end

      "topology do\n" <> Enum.reduce(2..links, inner, around) <> "\nend\n"
    end

    test "two root links" do
      error =
        mistake("""
          topology do
            link :base
            link :other
          end
        """)

      assert error.line == 5

      assert error.reason ==
               "There can only be one link at the root: :other is a second one beside :base, declared at lib/robot.ex:4; connect :other by a joint"
    end

    test "two links of one name" do
      error =
        mistake("""
          topology do
            link :base do
              joint :j do
                type :fixed
                link :base
              end
            end
          end
        """)

      assert error.path == [:topology, :base, :j, :base]
      assert error.reason =~ "duplicate name :base: link :base has the name of a link"
    end

    test "a joint without a child link" do
      error =
        mistake("""
          topology do
            link :base do
              joint :j do
                type :fixed
              end
            end
          end
        """)

      assert error.path == [:topology, :base, :j]
      assert error.line == 5

      assert error.reason ==
               "All joints must connect to a child link: joint :j has no child link; add `link :name` inside it"
    end

    test "a joint with two child links" do
      error =
        mistake("""
          topology do
            link :base do
              joint :j do
                type :fixed
                link :a
                link :b
              end
            end
          end
        """)

      assert error.line == 8
      assert error.reason =~ ":b is a second child link of joint :j"
      assert error.reason =~ "give :b a joint of its own"
    end

    test "a joint without a type, or of an unknown one" do
      error = mistake("  topology do\n link :b do\n joint :j do\n link :a\n end\n end\n end")
      assert error.reason =~ "joint :j has no type; add `type` with one of :revolute, :continuous"

      error = mistake("  topology do\n link :b do\n joint :j do\n type :ball\n end\n end\n end")

      assert error.reason ==
               "invalid value for :type option: expected one of [:revolute, :continuous, :prismatic, :fixed, :floating, :planar], got: :ball"

      assert error.line == 6
    end

    test "missing limits on a revolute or prismatic joint" do
      for type <- [:revolute, :prismatic] do
        error =
          mistake("""
            topology do
              link :base do
                joint :j do
                  type #{inspect(type)}
                  link :a
                end
              end
            end
          """)

        assert error.line == 5

        assert error.reason =~
                 "Limits must be present for #{type} joints: joint :j has none; add `limit lower: "
      end
    end

    test "a unit of the wrong kind" do
      joint = fn type, inside ->
        "topology do\n link :b do\n joint :j do\n type #{inspect(type)}\n #{inside}\n link :a\n end\n end\n end"
      end

      assert mistake(
               joint.(
                 :revolute,
                 "limit lower: ~u(0 meter), upper: ~u(90 degree), effort: ~u(1 newton_meter), velocity: ~u(1 radian_per_second)"
               )
             ).reason =~
               "limit: Expected unit 0 meter of :lower to be compatible with degree: `meter` is not compatible with a `revolute` joint"

      assert mistake(
               joint.(
                 :prismatic,
                 "limit effort: ~u(1 newton_meter), velocity: ~u(1 meter_per_second)"
               )
             ).reason =~
               "limit: Expected unit 1 newton meter of :effort to be compatible with newton: `newton-meter` is not compatible with a `prismatic` joint"

      assert mistake(joint.(:fixed, "origin x: ~u(1 degree)")).reason =~
               "invalid value for :x option: expected a length such as ~u(0.1 meter), got: 1 degree"

      assert mistake(joint.(:fixed, "origin x: 0.1")).reason =~
               "invalid value for :x option: expected a length such as ~u(0.1 meter), got: 0.1"

      error = mistake("sensors do\n sensor :s, BB.Test.Probe, max_silence: ~u(1 meter)\n end")

      assert error.reason ==
               "invalid value for :max_silence option: expected a time above zero such as ~u(100 millisecond), got: 1 meter"

      assert error.path == [:sensors, :s]
    end

    test "a limit whose lower end is above its upper end" do
      error =
        mistake("""
          topology do
            link :b do
              joint :j, type: :revolute do
                limit lower: ~u(90 degree), upper: ~u(-90 degree), effort: ~u(1 newton_meter), velocity: ~u(1 radian_per_second)
                link :a
              end
            end
          end
        """)

      assert error.reason == "limit: lower 90 degree is above upper -90 degree; swap them"
    end

    test "a child that does not implement its behaviour" do
      error = mistake("  sensors do\n    sensor :s, {String, []}\n  end")
      assert error.line == 4

      assert error.reason ==
               "sensor :s: String must implement the BB.Sensor behaviour; add `use BB.Sensor` to it"
    end

    test "not a child that cannot be loaded, of which a warning tells" do
      warning =
        capture_io(:stderr, fn ->
          declared =
            robot do
              sensors do
                sensor :s, BB.Sensor.Nonesuch
              end
            end

          assert Map.keys(declared.robot().sensors) == [:s]
        end)

      assert warning =~ "sensor :s: module BB.Sensor.Nonesuch cannot be loaded"
    end

    test "a child that is neither a module nor a module with keywords" do
      assert mistake("sensors do\n sensor :s, \"imu\"\n end").reason ==
               ~s(sensor :s: expected a module or {module, options}, got: "imu")

      assert mistake("sensors do\n sensor :s, {BB.Test.Probe, %{rate: 1}}\n end").reason ==
               "sensor :s: expected keywords for the options of BB.Test.Probe, got: %{rate: 1}"
    end

    test "an option that cannot be compiled" do
      error = mistake("sensors do\n sensor :s, {BB.Test.Probe, [rate: hd([fn -> 1 end])]}\n end")
      assert error.reason =~ "sensor :s: option :rate cannot be part of a compiled module"
      assert error.reason =~ "write a function as `fn` or & in the option itself"
    end

    test "a name that is no atom" do
      assert mistake("topology do\n link \"base\"\n end").reason ==
               ~s(the name of a link must be an atom such as :my_link, got: "base")
    end

    test "a field that the entity does not have" do
      assert mistake("sensors do\n sensor :s, BB.Test.Probe, require: true\n end").reason ==
               "a sensor has no :require; it takes :required, :retain, :max_silence, :transmission, :estimator"

      assert mistake("settings nme: :x").reason ==
               "settings has no :nme; it takes :name, :topic_prefix, :parameter_store, :registry_module, :registry_options, :supervisor_module, :topology_max_restarts, :topology_max_seconds"
    end

    test "a field that is given twice" do
      assert mistake("settings do\n name :a\n name :b\n end").reason ==
               "name is given twice; keep one of them"

      error = mistake("settings name: :a\n settings name: :b")
      assert error.reason == "name is given twice; keep one of them"
    end

    test "a value of the wrong type" do
      assert mistake("settings name: \"rover\"").reason ==
               ~s(invalid value for :name option: expected atom, got: "rover")
    end

    test "a max_silence that its driver says cannot be measured" do
      declared = fn answer ->
        """
        sensors do
          sensor :s, {BB.DslTest.Judge, answer: #{answer}}, max_silence: ~u(1 second)
        end
        """
      end

      error = mistake(declared.(~s({:error, "it has no topic; name one"})))
      assert error.reason == "sensor :s: it has no topic; name one"
      assert error.path == [:sensors, :s]

      for {answer, words} <- [{":yes", "got: :yes"}, {":raise", "(RuntimeError) no idea"}] do
        assert mistake(declared.(answer)).reason =~ "BB.DslTest.Judge.max_silence/1"
        assert mistake(declared.(answer)).reason =~ words
      end

      assert robot(do: sensors(do: sensor(:s, {BB.DslTest.Judge, answer: {:error, "no"}})))
    end

    test "a word in the wrong place" do
      error =
        mistake("""
          topology do
            link :base do
              joint :j do
                type :fixed
                link :tip do
                  type :fixed
                end
              end
            end
          end
        """)

      assert error.path == [:topology, :base, :j, :tip]
      assert error.reason =~ "type cannot stand in a link; it belongs in a joint or a parameter"

      error =
        mistake("""
          topology do
            link :base do
              joint :j do
                joint :k do
                end
              end
            end
          end
        """)

      assert error.reason =~ "joint cannot stand in a joint; it belongs in topology or a link"
    end
  end

  describe "the formatter's exports" do
    setup do
      {config, _} = Code.eval_file(".formatter.exs")
      %{words: config[:export][:locals_without_parens], own: config[:locals_without_parens]}
    end

    test "keep a declaration without parentheses", %{words: words} do
      source = """
      defmodule MyRobot do
        use BB

        settings do
          name :my_robot
          parameter_store {BB.Parameter.Store.Log, path: "/data/params"}
          registry_module Registry
          registry_options partitions: 2
          supervisor_module Supervisor
        end

        parameters do
          param :debug, type: :boolean, default: false

          group :imu do
            param :rate do
              type {:unit, :hertz}
              default ~u(100 hertz)
              min ~u(1 hertz)
              max ~u(1 kilohertz)
              doc "Samples a second."
            end
          end
        end

        controllers do
          controller :balance, {BB.Test.Brain, rate: 1}, required: true
        end

        topology do
          link :base do
            sensor :imu, {BB.Test.Probe, rate: param([:imu, :rate])}, required: true

            joint :shoulder, type: :revolute do
              origin z: ~u(0.1 meter)

              limit lower: ~u(-90 degree),
                    upper: ~u(90 degree),
                    effort: ~u(1 newton_meter),
                    velocity: ~u(1 radian_per_second)

              sensor :encoder, BB.Test.Probe do
                max_silence ~u(1 second)

                transmission do
                  reduction 1.0
                  offset ~u(5 degree)
                  reversed? true
                end
              end

              actuator :servo, {BB.Test.Motor, rate: 1}, required: true
              link :arm
            end
          end
        end
      end
      """

      formatted = source |> Code.format_string!(locals_without_parens: words) |> to_string()
      assert formatted <> "\n" == source
    end

    test "hold in this project too", %{words: words, own: own} do
      assert own == words
    end

    test "name every word of the DSL", %{words: words} do
      modules = [
        BB.Dsl.Robot | for(kind <- Grammar.kinds(), kind != :robot, do: Words.module(kind))
      ]

      defined =
        for module <- modules,
            {word, arity} <- module.__info__(:macros),
            arity > 0,
            do: {word, arity}

      assert Enum.sort(Enum.uniq(defined)) == Grammar.calls()
      assert Enum.sort(Enum.uniq(defined)) == Enum.sort(words)
    end
  end
end

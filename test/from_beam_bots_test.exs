defmodule FromBeamBotsTest do
  @moduledoc """
  Holds `docs/guides/from-beam-bots.md` to the truth: each row of its tables, and each paragraph
  of what is better or different, has tests, which are listed here by their names.
  """

  use ExUnit.Case, async: true

  @guide File.read!("docs/guides/from-beam-bots.md")

  # The first cell of a row: `{file, names of its tests or describes}`.
  @packages %{
    "Spark" => [
      {"test/project_test.exs", ["a project with a package that depends on :bb of Hex"]},
      {"test/bb/options_test.exs", ["a %Spark.Options{}"]}
    ],
    "Localize" => [
      {"test/project_test.exs", ["a project with a package that depends on :bb of Hex"]}
    ],
    "telemetry" => [
      {"test/bb/telemetry_test.exs",
       ["events are handed on to :telemetry when that module is loaded"]}
    ]
  }

  @same %{
    "`use BB`" => [{"test/bb_test.exs", ["use BB"]}],
    "the DSL" => [
      {"test/bb/dsl/every_word_test.exs",
       ["the robot has every word of the grammar", "it starts", "its links", "its joints"]},
      {"test/bb/dsl_test.exs", ["a declaration", "the formatter's exports"]}
    ],
    "`BB.Robot`" => [
      {"test/bb/dsl/every_word_test.exs",
       ["its links", "its joints", "its places that follow parameters are listed"]},
      {"test/bb/robot_test.exs", ["the tree", "links, joints and components are found by name"]},
      {"test/bb/robot/runtime_test.exs", ["the description follows the parameters", "a state"]}
    ],
    "`BB.Dsl.Info`" => [{"test/bb/dsl/every_word_test.exs", ["BB.Dsl.Info"]}],
    "`BB`" => [{"test/bb_test.exs", ["the facade"]}],
    "`BB.PubSub`" => [
      {"test/bb/pub_sub_test.exs", ["subscribe", "unsubscribe", "publish", "paths", "order"]}
    ],
    "`BB.Message`" => [
      {"test/bb/message_test.exs", ["the envelope", "new", "use BB.Message"]},
      {"test/bb/message/payloads_test.exs", ["Geometry is made by position too"]},
      {"test/bb/message/option_test.exs", ["a payload of a user has such fields"]}
    ],
    "`BB.Math`" => [
      {"test/bb/math/reference_test.exs", ["covers the functions that compute"]},
      {"test/bb/math/quaternion_test.exs", ["slerp turns at constant speed on the shorter way"]}
    ],
    "`BB.Sensor`" => [
      {"test/bb/sensor_test.exs",
       [
         "the schema of options",
         "the defaults of the optional callbacks",
         "publish_joint_state"
       ]},
      {"test/bb/sensor/mimic_test.exs",
       ["follows every sensor of the joint, and none of the joints beyond it"]},
      {"test/bb/sensor/open_loop_position_estimator_test.exs", ["its callbacks"]},
      {"test/bb/actuator/server_test.exs",
       ["each kind has a server for tests of drivers, with a name of the caller's"]},
      {"test/packages_test.exs",
       ["a sensor with quantities as options", "a sensor with a sampler process"]}
    ],
    "`BB.Actuator`" => [
      {"test/bb/actuator/commands_test.exs",
       [
         "the start",
         "a command",
         "a refusal",
         "sending by :pubsub, the default of set_position/4,",
         "sending by :broadcast, the default of the others,",
         "sending by :direct",
         "to_joint_space/3 converts what a driver reports"
       ]},
      {"test/packages_test.exs", ["a servo that calls its controller"]}
    ],
    "`BB.Controller`" => [
      {"test/bb/controller/ready_made_test.exs", ["PatternMatch", "Threshold"]},
      {"test/packages_test.exs", ["a controller for payloads that are options"]}
    ],
    "`BB.Estimator`" => [
      {"test/bb/estimator_test.exs", ["an estimator", "the input", "an output", "health"]},
      {"test/packages_test.exs", ["an estimator of the attitude"]}
    ],
    "`BB.Command`" => [
      {"test/bb/command_test.exs",
       [
         "a robot's commands",
         "a handler",
         "a result",
         "a command that crashes",
         "an execution ends",
         "a command may start",
         "the events of an execution"
       ]},
      {"test/bb/command/goal_test.exs", ["strings become values of the argument's type"]},
      {"test/bb/safety/route_test.exs", ["a robot is armed and disarmed by its commands"]}
    ],
    "`BB.Bridge`" => [
      {"test/bb/bridge_test.exs",
       [
         "a bridge is a GenServer of its robot, with its options",
         "a bridge answers for remote parameters",
         "a bridge hears of the changes of parameters",
         "in a simulated robot a bridge"
       ]}
    ],
    "states" => [{"test/bb/command_test.exs", ["the state of a robot"]}],
    "simulation" => [
      {"test/bb/sim_test.exs",
       ["has simulated actuators, real sensors, and controllers as they declare", "a motion"]}
    ],
    "`BB.Process`" => [
      {"test/bb/process_test.exs",
       [
         "via/2 names a component by robot and name",
         "whereis/2 is the component's process, or :undefined"
       ]},
      {"test/bb/sim_test.exs", ["BB.Process.child_spec/5,6 starts a component, simulated or not"]}
    ],
    "supervision" => [
      {"test/bb/supervisor_test.exs",
       [
         "the tree",
         "has supervisors in the robot's registry, and tasks for anybody",
         "starts controllers before the actuators that call them in init/1"
       ]}
    ],
    "`BB.Parameter`" => [
      {"test/bb/parameter_test.exs",
       ["get", "set", "set_many", "list", "register", "a remote parameter"]},
      {"test/bb/parameter/type_test.exs", ["an option type"]},
      {"test/bb/parameter/schema_test.exs", ["a robot's module"]},
      {"test/bb/parameter/store/dets_test.exs", ["starts a robot with the values of Beam Bots"]}
    ],
    "`BB.Safety`" => [
      {"test/bb/safety_test.exs",
       ["arm/1", "disarm/2", "force_disarm/1", "epoch/1", "register/2", "each transition"]},
      {"test/bb/safety/controller_test.exs",
       ["a topology supervisor that dies leaves an armed robot in error"]}
    ],
    "`BB.Diagnostic`" => [
      {"test/bb/diagnostic_test.exs",
       ["new/1", "publish/1 emits the struct as metadata, without measurements"]}
    ],
    "`BB.Error`" => [
      {"test/bb/error_test.exs",
       [
         "each error has a text without any field, a class and a severity",
         "an error of a driver"
       ]}
    ],
    "`BB.Transmission`" => [
      {"test/bb/transmission_test.exs",
       [
         "position motor = s·r·(joint − offset); rate motor = s·r·joint; effort motor = s·joint/r"
       ]}
    ],
    "`BB.Loop`" => [
      {"test/bb/loop_test.exs", ["arm", "tick", "observe", "the telemetry event"]},
      {"test/bb/loop/driver_test.exs",
       ["a driver that sends itself the first tick keeps ticking at the rate"]}
    ],
    "`BB.Unit`, `BB.Unit.Option`, `BB.Robot.Units`" => [
      {"test/bb/unit_test.exs", ["the sigil", "unit_name", "validate_unit"]},
      {"test/bb/unit/option_test.exs", ["unit_type", "a value"]},
      {"test/bb/robot/units_test.exs", ["extract_float converts nothing"]}
    ]
  }

  @replacements %{
    "NimbleOptions, Spark.Options" => [
      {"test/bb/options_test.exs", ["types", "options", "a %Spark.Options{}", "merge", "docs"]}
    ],
    "the errors of the DSL" => [
      {"test/bb/dsl_test.exs", ["a mistake is refused while the module compiles:"]}
    ],
    "Localize.Unit" => [
      {"test/bb/unit_test.exs", ["new", "convert", "compare", "compatible?", "to_string!"]}
    ],
    "`:telemetry`" => [
      {"test/bb/telemetry_test.exs",
       ["span", "events are handed on to :telemetry when that module is loaded"]}
    ]
  }

  # The bold beginning of a paragraph.
  @better %{
    "Faults" => [
      {"test/bb/supervisor_test.exs", ["a fault of one sensor never reaches another:"]},
      {"test/bb/component/lifecycle_test.exs", ["a check of its activity"]}
    ],
    "PubSub" => [
      {"test/bb/pub_sub/rate_limit_test.exs", :all},
      {"test/bb/pub_sub/replay_test.exs", :all},
      {"test/bb/pub_sub/queue_limit_test.exs", :all},
      {"test/bb/pub_sub/retention_test.exs", :all},
      {"test/bb/pub_sub/statistics_test.exs", :all}
    ],
    "Messages" => [
      {"test/bb/message_test.exs", ["the compiled constructor and BB.Options agree"]}
    ],
    "Loops" => [
      {"test/bb/loop_test.exs",
       [
         "before its deadline takes the place of the armed one",
         "and arming again and again do not put the tick off for ever",
         "takes a message"
       ]},
      {"test/bb/clock_test.exs", :all}
    ],
    "Quantities" => [{"test/bb/unit_test.exs", ["is exact across prefixes"]}],
    "Sensors" => [{"test/bb/supervisor_test.exs", ["when the robot stops,"]}],
    "Parameters" => [
      {"test/bb/parameter/type_test.exs",
       ["is one of BB.Options or a unit, alone and inside another type"]},
      {"test/bb/parameter_test.exs", ["a type with a function of others", "at the start"]}
    ],
    "Safety" => [
      {"test/bb/safety_test.exs",
       [
         "stays registered when its process dies",
         "all handlers run at once",
         "inhibit/3",
         "the state machine does as a plain model does, whatever is killed meanwhile"
       ]}
    ],
    "Robots" => [
      {"test/bb/dsl/mistakes_test.exs",
       ["a word that cannot stand where it stands", "may have joints alone, or no topology"]},
      {"test/bb/robot/kinematics_test.exs", :all}
    ],
    "Commands" => [
      {"test/bb/command_test.exs", ["by a kill when it hangs", "need their required arguments"]},
      {"test/bb/safety/route_test.exs",
       [
         "when the disarm command fails, the hardware is made safe, and the robot is in error"
       ]}
    ],
    "Mimic" => [
      {"test/bb/sensor/mimic_test.exs",
       ["multiplier is 1.0, offset 0.0, and the source may be a sensor, by name or path"]}
    ],
    "In addition to Beam Bots" => [
      {"test/bb/ring_test.exs", :all},
      {"test/bb/sensor/native_process_test.exs", :all}
    ]
  }

  @different %{
    "A component that cannot start" => [
      {"test/bb/supervisor_test.exs", ["one that cannot come up changes nothing for the others"]},
      {"test/packages_test.exs", ["that has no chip is down alone, with its reason"]}
    ],
    "Wrong options" => [
      {"test/packages_test.exs",
       ["refuses a quantity of another kind: a warning, and the robot does not start"]},
      {"test/bb/supervisor_test.exs", ["wrong options"]}
    ],
    "A handler that hangs" => [
      {"test/bb/safety_test.exs", ["{:timeout, ms} when it hangs, and it is killed"]}
    ],
    "The state `:error`" => [
      {"test/bb/safety_test.exs", ["force_disarm/1", "inhibit/3"]},
      {"test/bb/safety/model_test.exs", :all}
    ]
  }

  for {title, held} <- [
        {"Packages that depend on `:bb`", @packages},
        {"The same", @same},
        {"Replacements for libraries", @replacements}
      ] do
    test "each row of “#{title}” has tests" do
      assert unquote(title)
             |> section()
             |> rows()
             |> Enum.map(&hd/1)
             |> missing(unquote(Macro.escape(held))) == []
    end
  end

  for {title, held} <- [{"Better", @better}, {"Different on purpose", @different}] do
    test "each paragraph of “#{title}” has tests" do
      assert unquote(title) |> section() |> paragraphs() |> missing(unquote(Macro.escape(held))) ==
               []
    end
  end

  test "the tests that are listed exist" do
    tables = [@packages, @same, @replacements, @better, @different]

    absent =
      for table <- tables,
          {row, held} <- table,
          {file, names} <- held,
          name <- absent(file, names),
          do: "#{row}: #{file} has no test #{inspect(name)}"

    assert absent == []
  end

  test "the modules that a row names exist, with the functions that it names by their arity" do
    for [first | _] = row <- rows(section("The same")), text = Enum.join(row, " ") do
      named = modules(text)
      for module <- named, do: assert(exists?(module), "#{inspect(module)} in #{first}")

      for {name, arity} <- functions(text) do
        assert Enum.any?([Ganglion.Robot | named], &exports?(&1, name, arity)),
               "#{name}/#{arity} in #{first}"
      end
    end
  end

  test "the modules that are missing do not exist" do
    modules = modules(section("Missing")) -- [BB]
    assert modules != []
    assert Enum.filter(modules, &exists?/1) == []
  end

  defp missing(found, held) do
    assert found != []
    (found -- Map.keys(held)) ++ (Map.keys(held) -- found)
  end

  defp section(title) do
    [_, text] = String.split(@guide, "\n## #{title}\n", parts: 2)
    text |> String.split("\n## ") |> hd()
  end

  # The cells of each row below the line of dashes.
  defp rows(text) do
    for "| " <> line <- String.split(text, "\n") |> Enum.drop_while(&(&1 != "|---|---|")),
        do: line |> String.trim_trailing(" |") |> String.split(" | ", parts: 2)
  end

  defp paragraphs(text), do: for([_, name] <- Regex.scan(~r/^\*\*(.+?)\.?\*\*/m, text), do: name)

  defp absent(file, :all), do: if(names(file) == [], do: ["at all"], else: [])
  defp absent(file, names), do: names -- names(file)

  # A name that ends with an interpolation is not listed. A describe counts with its tests.
  defp names(file) do
    {_ast, names} =
      file
      |> File.read!()
      |> Code.string_to_quoted!()
      |> Macro.prewalk([], fn
        {kind, _, [name | _]} = ast, names when kind in [:test, :property] and is_binary(name) ->
          {ast, [name | names]}

        {:describe, _, [name, [do: block]]} = ast, names when is_binary(name) ->
          {ast, if(tests?(block), do: [name | names], else: names)}

        ast, names ->
          {ast, names}
      end)

    names
  end

  defp tests?(block) do
    {_ast, found} =
      Macro.prewalk(
        block,
        false,
        &{&1, &2 or match?({kind, _, [_ | _]} when kind in [:test, :property], &1)}
      )

    found
  end

  defp modules(text) do
    for [name] <- Regex.scan(~r/\bBB(?:\.[A-Z]\w*)*/, text), uniq: true, do: Module.concat([name])
  end

  # `call/3,4` is call/3 and call/4; `&Module.function/1` is none of ours.
  defp functions(text) do
    text = String.replace(text, ~r/&[\w.]+/, "")

    for [_, name, arities] <- Regex.scan(~r/(?<!\w)([a-z_]\w*[?!]?)\/(\d(?:,\d)*)/, text),
        arity <- String.split(arities, ","),
        do: {String.to_atom(name), String.to_integer(arity)}
  end

  # Names in a robot's registry, which are no modules.
  @registered [
    BB.TopologySupervisor,
    BB.SensorSupervisor,
    BB.ControllerSupervisor,
    BB.TaskSupervisor
  ]

  # `BB.Math` is no module, but the beginning of others.
  defp exists?(module) do
    module in @registered or Code.ensure_loaded?(module) or
      Enum.any?(Application.spec(:ganglion, :modules), &below?(&1, module))
  end

  defp below?(module, start), do: String.starts_with?("#{module}", "#{start}.")

  # `use BB` defines functions of the robot: any robot has them.
  defp exports?(module, name, arity) do
    Code.ensure_loaded?(module) and
      (function_exported?(module, name, arity) or macro_exported?(module, name, arity))
  end
end

defmodule BB.Sensor.NativeProcess.Options do
  @moduledoc "The schema of the options that the docs of `BB.Sensor.NativeProcess` list."
  @moduledoc no_example: "internal: the docs of BB.Sensor.NativeProcess list the options"

  @schema BB.Options.new!(
            program: [
              type: {:custom, BB.Sensor.NativeProcess.Program, :check, []},
              required: true,
              type_doc: "`t:BB.Sensor.NativeProcess.Program.t/0`",
              doc: """
              `{:my_app, "name"}`, a program in the `priv/bin` of that application; the name of \
              a program that ships with Ganglion; a path; a name that is looked up in `PATH`; or \
              a function that returns one of these at each start: `&MyRobot.detector/0` or \
              `{module, function, arguments}`.
              """
            ],
            topics: [
              type: :keyword_list,
              default: [],
              doc: """
              The ring topics that the program works with, as options of its command line: \
              `frames: "camera"` becomes `--frames camera`, with the robot's topic prefix before \
              `camera` (`BB.Topic`).
              """
            ],
            publishes: [
              type: {:list, {:or, [:atom, :string]}},
              doc: """
              The ring topics that the program publishes, for `max_silence`: keys of `topics`, \
              or names. Without it: the topics that this program is the publisher of; all of \
              `topics`, if it is the publisher of none.
              """
            ],
            args: [
              type: {:or, [{:list, :string}, {:tuple, [:atom, :atom, {:list, :any}]}]},
              default: [],
              doc: """
              Further arguments, or `{module, function, arguments}` that returns them at each \
              start.
              """
            ],
            env: [
              type: {:list, {:tuple, [:string, :string]}},
              default: [],
              doc: "Environment variables in addition to the BEAM's own."
            ],
            grace_ms: [
              type: {:in, 0..10_000},
              default: 500,
              doc: """
              Milliseconds from SIGTERM to SIGKILL when the program is stopped; its sensor waits.
              """
            ],
            halt_ms: [
              type: {:or, [{:in, 0..3_600_000}, {:literal, :infinity}]},
              default: 1_000,
              doc: "Milliseconds for which SIGSTOP may halt the program before it is restarted."
            ],
            hang_ms: [
              type: {:or, [{:in, 0..3_600_000}, {:literal, :infinity}]},
              default: 10_000,
              doc: """
              Milliseconds beyond its `max_silence` for which the program may publish nothing \
              before it is restarted. Set it longer than the program takes to start.
              """
            ],
            nice: [
              type: {:in, 0..19},
              default: 5,
              doc: """
              The program's nice value: a higher one yields more to other processes. The BEAM, \
              with the sensors' own deadlines, runs at 0.
              """
            ],
            log_level: [
              type: {:in, [:debug, :info, :notice, :warning, :error]},
              default: :info,
              doc: "The level at which the program's output is logged."
            ],
            log_rate: [
              type: {:in, 1..1_000},
              default: 100,
              doc: "Lines a second that the program may print; ten times as many at once."
            ]
          )

  @doc "Returns the schema of the options."
  @spec schema() :: BB.Options.t()
  def schema, do: @schema
end

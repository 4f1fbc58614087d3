defmodule BB.Firmware.Guard.Options do
  @moduledoc "The schema of the options that the docs of `BB.Firmware.Guard` list."
  @moduledoc no_example: "internal: the docs of BB.Firmware.Guard list the options"

  @folder "/data/guard"

  @doc "Returns the default of `folder:`."
  @spec folder() :: Path.t()
  def folder, do: @folder

  @doc "Returns the schema of the options, with the default of `name:`."
  @spec schema(module()) :: BB.Options.t()
  def schema(name) do
    BB.Options.new!(
      robot: [type: :module, required: true, doc: "The robot that must work."],
      name: [type: :any, default: name, doc: "The name of the process."],
      board: [
        type: {:tuple, [:module, :any]},
        doc: "The board (`BB.Firmware.Board`); default: the configured one."
      ],
      network: [
        type: {:tuple, [:module, :any]},
        doc: "The network (`BB.Firmware.Network.Adapter`); default: the configured one."
      ],
      reach: [
        type: {:in, [:none, :lan, :internet]},
        default: :lan,
        doc: "The required reach of the network; `:none` for no network."
      ],
      stability_ms: [
        type: :non_neg_integer,
        default: 10_000,
        doc: "The time in milliseconds for which all checks must be good without a break."
      ],
      deadline_ms: [
        type: :pos_integer,
        default: 300_000,
        doc: "The time in milliseconds from the start of the VM to the revert."
      ],
      fresh_ms: [
        type: :pos_integer,
        default: 1_000,
        doc: "The greatest age in milliseconds of a reading, and of a good check."
      ],
      poll_ms: [
        type: :pos_integer,
        default: 250,
        doc: "The period of the checks in milliseconds."
      ],
      folder: [type: :string, default: @folder, doc: "The folder of the findings."],
      topic: [
        type: :string,
        default: "firmware_guard",
        doc:
          "The ring topic for the round trip, of the guard alone, behind the robot's " <>
            "topic prefix (`BB.Topic`)."
      ],
      started_ms: [
        type: :integer,
        doc: "The start of the VM on the monotonic clock, in milliseconds."
      ]
    )
  end
end

defmodule BB.Firmware.Gate.Options do
  @moduledoc "The schema of the options that the docs of `BB.Firmware.Gate` list."
  @moduledoc no_example: "internal: the docs of BB.Firmware.Gate list the options"

  @configured [
    board: [
      type: {:tuple, [:module, :any]},
      doc: "The board (`BB.Firmware.Board`); default: the configured one."
    ],
    public_key: [
      type: :string,
      default: "/etc/ganglion/firmware.pub",
      doc: "The file with the public key of updates."
    ],
    folder: [
      type: :string,
      doc: "The folder with the marker of an update; default: the folder of `BB.Firmware.Guard`."
    ],
    settle_ms: [
      type: :non_neg_integer,
      default: 3_000,
      doc:
        "The time in milliseconds that the next upload waits after an upload. It ends after " <>
          "the report whether the upload succeeded."
    ]
  ]

  @doc "Returns the schema of a gate's options, with the default of `name:`."
  @spec schema(module()) :: BB.Options.t()
  def schema(name) do
    BB.Options.new!(
      [
        robot: [type: :module, required: true, doc: "The robot that must not be armed."],
        name: [type: :any, default: name, doc: "The name of the process."]
      ] ++ @configured
    )
  end

  @doc "Returns the schema of the configured options, for a gate that does not run."
  @spec configured() :: BB.Options.t()
  def configured, do: BB.Options.new!(@configured)
end

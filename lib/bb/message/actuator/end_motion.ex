defmodule BB.Message.Actuator.EndMotion do
  @moduledoc "An actuator's motion has ended, where and why."

  @reasons [:completed, :cancelled, :limit_reached, :fault]

  defstruct [:position, :reason, :detail, :message, :command_id]

  @type reason :: :completed | :cancelled | :limit_reached | :fault

  @type t :: %__MODULE__{
          position: float(),
          reason: reason(),
          detail: atom(),
          message: String.t() | nil,
          command_id: reference() | nil
        }

  use BB.Message,
    schema: [
      position: [type: :float, required: true, doc: "In rad, or m of a prismatic joint."],
      reason: [type: {:in, @reasons}, required: true, doc: "Why it ended."],
      detail: [type: :atom, default: nil, doc: "More of it for programs, such as `:stall`."],
      message: [type: {:or, [:string, nil]}, default: nil, doc: "More of it for people."],
      command_id: [
        type: {:or, [:reference, nil]},
        default: nil,
        doc: "Of the command that the motion followed."
      ]
    ]
end

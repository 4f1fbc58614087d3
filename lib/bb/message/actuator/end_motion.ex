defmodule BB.Message.Actuator.EndMotion do
  @moduledoc """
  The message that the motion of an actuator has ended, with the position and the reason.

  An actuator publishes it after `BB.Message.Actuator.BeginMotion`:

      iex> {:ok, message} = BB.Message.Actuator.EndMotion.new(:shoulder,
      ...>   position: 1.2, reason: :fault, detail: :stall)
      iex> message.payload.reason
      :fault
  """

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
      position: [
        type: :float,
        required: true,
        doc: "The position at the end, in rad, or in m for a prismatic joint."
      ],
      reason: [type: {:in, @reasons}, required: true, doc: "The reason for the end."],
      detail: [type: :atom, default: nil, doc: "A detail for programs, such as `:stall`."],
      message: [type: {:or, [:string, nil]}, default: nil, doc: "A detail for people."],
      command_id: [
        type: {:or, [:reference, nil]},
        default: nil,
        doc: "The id of the command that caused the motion."
      ]
    ]
end

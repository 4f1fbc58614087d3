defmodule BB.Message.Actuator.Command.Stop do
  @moduledoc """
  The command to stop moving.

  Stopping does not make an actuator safe; disarming does (`BB.Safety.disarm/1`).

      iex> {:ok, message} = BB.Message.Actuator.Command.Stop.new(:wheel, mode: :decelerate)
      iex> message.payload.mode
      :decelerate
  """

  defstruct [:command_id, mode: :immediate]

  @type t :: %__MODULE__{mode: :immediate | :decelerate, command_id: reference() | nil}

  use BB.Message,
    schema: [
      mode: [
        type: {:in, [:immediate, :decelerate]},
        default: :immediate,
        doc: "Whether to stop at once or to decelerate."
      ],
      command_id: [
        type: {:or, [:reference, nil]},
        default: nil,
        doc: "An id that the messages about the resulting motion repeat."
      ]
    ]
end

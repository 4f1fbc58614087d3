defmodule BB.Message.Sensor.Contact do
  @moduledoc """
  The state of a switch: a bumper, a limit switch or an emergency stop.

      iex> {:ok, message} = BB.Message.Sensor.Contact.new(:bumper, pressed: true)
      iex> message.payload.pressed
      true

  `BB.Sensor.ContactSwitch` and `BB.Sensor.EmergencyStop` publish it.
  """

  defstruct [:pressed]

  @type t :: %__MODULE__{pressed: boolean()}

  use BB.Message,
    schema: [
      pressed: [
        type: :boolean,
        required: true,
        doc: "Whether the switch is pressed, whatever the polarity of its wiring."
      ]
    ]
end

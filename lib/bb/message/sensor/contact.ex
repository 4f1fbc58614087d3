defmodule BB.Message.Sensor.Contact do
  @moduledoc "A switch that something presses: bumper, limit switch, emergency stop."

  defstruct [:pressed]

  @type t :: %__MODULE__{pressed: boolean()}

  use BB.Message,
    schema: [
      pressed: [
        type: :boolean,
        required: true,
        doc: "Whether it is pressed, whatever the wiring's polarity."
      ]
    ]
end

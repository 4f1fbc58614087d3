defmodule BB.Message.Sensor.PowerState do
  @moduledoc "What a power monitor measures on one rail."

  defstruct [:voltage, :current, :power, :shunt_voltage]

  @type t :: %__MODULE__{
          voltage: float(),
          current: float(),
          power: float() | nil,
          shunt_voltage: float() | nil
        }

  use BB.Message,
    schema: [
      voltage: [type: :float, required: true, doc: "Of the bus, in V."],
      current: [type: :float, required: true, doc: "In A, signed: the sign says the direction."],
      power: [type: {:or, [:float, nil]}, default: nil, doc: "In W, when the chip measures it."],
      shunt_voltage: [type: {:or, [:float, nil]}, default: nil, doc: "Across the shunt, in V."]
    ]
end

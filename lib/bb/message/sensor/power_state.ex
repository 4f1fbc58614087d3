defmodule BB.Message.Sensor.PowerState do
  @moduledoc """
  The voltage, current and power on one rail, as a power monitor measures them.

      iex> fields = [voltage: 7.4, current: -0.2]
      iex> {:ok, message} = BB.Message.Sensor.PowerState.new(:battery, fields)
      iex> message.payload.power
      nil

  Drivers of power monitors publish it; the state of a battery is
  `BB.Message.Sensor.BatteryState`.
  """

  defstruct [:voltage, :current, :power, :shunt_voltage]

  @type t :: %__MODULE__{
          voltage: float(),
          current: float(),
          power: float() | nil,
          shunt_voltage: float() | nil
        }

  use BB.Message,
    schema: [
      voltage: [type: :float, required: true, doc: "The voltage of the rail, in V."],
      current: [type: :float, required: true, doc: "The current in A, signed by direction."],
      power: [
        type: {:or, [:float, nil]},
        default: nil,
        doc: "The power in W, if the chip measures it."
      ],
      shunt_voltage: [
        type: {:or, [:float, nil]},
        default: nil,
        doc: "The voltage across the shunt, in V."
      ]
    ]
end

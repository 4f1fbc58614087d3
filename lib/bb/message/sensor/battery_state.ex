defmodule BB.Message.Sensor.BatteryState do
  @moduledoc """
  The charge and health of a battery.

  Battery monitors publish it; a monitor that measures only voltage and current publishes
  `BB.Message.Sensor.PowerState`.

      iex> {:ok, message} = BB.Message.Sensor.BatteryState.new(:battery,
      ...>   voltage: 11.8, percentage: 0.64, power_supply_status: :discharging)
      iex> message.payload.percentage
      0.64
  """

  @statuses [:unknown, :charging, :discharging, :not_charging, :full]
  @healths [:unknown, :good, :overheat, :dead, :overvoltage, :cold]

  defstruct [
    :voltage,
    :percentage,
    current: 0.0,
    charge: 0.0,
    capacity: 0.0,
    power_supply_status: :unknown,
    power_supply_health: :unknown,
    present: true
  ]

  @type t :: %__MODULE__{
          voltage: float(),
          current: float(),
          charge: float(),
          capacity: float(),
          percentage: float() | nil,
          power_supply_status: :unknown | :charging | :discharging | :not_charging | :full,
          power_supply_health: :unknown | :good | :overheat | :dead | :overvoltage | :cold,
          present: boolean()
        }

  use BB.Message,
    schema: [
      voltage: [type: :float, required: true, doc: "The voltage in V."],
      current: [
        type: :float,
        default: 0.0,
        doc: "The current in A, negative while the battery discharges."
      ],
      charge: [type: :float, default: 0.0, doc: "The charge in Ah."],
      capacity: [
        type: :float,
        default: 0.0,
        doc: "The charge when the battery was last full, in Ah."
      ],
      percentage: [
        type: {:custom, __MODULE__, :check_percentage, []},
        default: nil,
        type_doc: "`t:float/0`",
        doc: "The charge as a fraction from 0.0 to 1.0; `nil` if unknown."
      ],
      power_supply_status: [
        type: {:in, @statuses},
        default: :unknown,
        doc: "One of #{Enum.map_join(@statuses, ", ", &"`#{inspect(&1)}`")}."
      ],
      power_supply_health: [
        type: {:in, @healths},
        default: :unknown,
        doc: "One of #{Enum.map_join(@healths, ", ", &"`#{inspect(&1)}`")}."
      ],
      present: [type: :boolean, default: true, doc: "Whether the battery is present."]
    ]

  @doc false
  def check_percentage(nil), do: {:ok, nil}
  def check_percentage(p) when is_float(p) and p >= 0.0 and p <= 1.0, do: {:ok, p}

  def check_percentage(p),
    do: {:error, "expected nil or a float from 0.0 to 1.0, got: #{inspect(p)}"}
end

defmodule BB.Message.System.Status do
  @moduledoc """
  How the computer fares that the robot runs on: heat, throttling, memory, load.

  `throttling` says what holds the processor back now, `throttled_before` what has done so since the computer was started:

    * `:under_voltage` - the supply's voltage is too low
    * `:frequency_capped` - the clock is limited
    * `:throttled` - the clock is reduced
    * `:soft_temperature_limit` - the processor is so hot that its clock is limited

  Each is `nil` on a computer that does not tell.
  """

  @causes [:under_voltage, :frequency_capped, :throttled, :soft_temperature_limit]

  defstruct [
    :temperature,
    :throttling,
    :throttled_before,
    :memory_total,
    :memory_available,
    :load_1_min,
    :load_5_min,
    :load_15_min,
    :processors
  ]

  @type cause :: :under_voltage | :frequency_capped | :throttled | :soft_temperature_limit

  @type t :: %__MODULE__{
          temperature: float() | nil,
          throttling: [cause()] | nil,
          throttled_before: [cause()] | nil,
          memory_total: pos_integer(),
          memory_available: non_neg_integer(),
          load_1_min: float(),
          load_5_min: float(),
          load_15_min: float(),
          processors: pos_integer()
        }

  @list {:or, [{:list, {:in, @causes}}, nil]}

  use BB.Message,
    schema: [
      temperature: [
        type: {:or, [:float, nil]},
        default: nil,
        doc: "Of the processor, in °C; `nil` where there is no such sensor."
      ],
      throttling: [type: @list, default: nil, doc: "What holds the processor back now."],
      throttled_before: [type: @list, default: nil, doc: "What has done so since the start."],
      memory_total: [type: :pos_integer, required: true, doc: "In bytes."],
      memory_available: [
        type: :non_neg_integer,
        required: true,
        doc: "What programs can still get without swapping, in bytes."
      ],
      load_1_min: [
        type: :float,
        required: true,
        doc:
          "How many tasks ran or waited for a processor or a disk, on average over the last minute."
      ],
      load_5_min: [type: :float, required: true, doc: "The same over five minutes."],
      load_15_min: [type: :float, required: true, doc: "The same over fifteen minutes."],
      processors: [
        type: :pos_integer,
        required: true,
        doc: "Processors in use: a load above their number means waiting."
      ]
    ]
end

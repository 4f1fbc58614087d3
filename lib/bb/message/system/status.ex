defmodule BB.Message.System.Status do
  @moduledoc """
  The state of the robot's computer: temperature, throttling, memory and load.

  `BB.Sensor.System` publishes it:

      iex> {:ok, message} = BB.Message.System.Status.new(:board, temperature: 51.2, processors: 4,
      ...>   memory_total: 512_000_000, memory_available: 301_000_000,
      ...>   load_1_min: 0.4, load_5_min: 0.3, load_15_min: 0.2)
      iex> message.payload.throttling
      nil

  `throttling` lists what limits the processor now, `throttled_before` what has limited it since
  the computer was started:

    * `:under_voltage` - the supply voltage is too low
    * `:frequency_capped` - the clock is limited
    * `:throttled` - the clock is reduced
    * `:soft_temperature_limit` - the clock is limited because the processor is hot

  Both are `nil` on a computer that does not report them.
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
        doc: "The temperature of the processor, in °C; `nil` without such a sensor."
      ],
      throttling: [type: @list, default: nil, doc: "The present limits of the processor."],
      throttled_before: [type: @list, default: nil, doc: "The limits since the start."],
      memory_total: [type: :pos_integer, required: true, doc: "The memory in bytes."],
      memory_available: [
        type: :non_neg_integer,
        required: true,
        doc: "The memory that programs can still allocate without swapping, in bytes."
      ],
      load_1_min: [
        type: :float,
        required: true,
        doc:
          "The mean number of tasks that ran or waited for a processor or a disk, over a minute."
      ],
      load_5_min: [type: :float, required: true, doc: "The mean over five minutes."],
      load_15_min: [type: :float, required: true, doc: "The mean over fifteen minutes."],
      processors: [
        type: :pos_integer,
        required: true,
        doc: "The number of processors in use. With a load above it, tasks wait."
      ]
    ]
end

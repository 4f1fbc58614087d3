defmodule BB.Message.Sensor.Status do
  @moduledoc """
  The status of a component, published on `[:sensor_status | path]` at each change.

      iex> {:ok, message} = BB.Message.Sensor.Status.new(:imu, state: :backoff,
      ...>   reason: :i2c_nak, restarts: 3, retry_in_ms: 400)
      iex> message.payload.state
      :backoff

  The states are:

    * `:up` - the component runs
    * `:backoff` - it ended, for `reason`, and restarts in `retry_in_ms` milliseconds
    * `:stale` - it runs, but has published or carried no message for longer than its
      `max_silence`
    * `:ignored` - it declined to start (`:ignore`), and is not restarted
  """

  @states [:up, :backoff, :stale, :ignored]

  defstruct [:state, :reason, :retry_in_ms, restarts: 0]

  @type state :: :up | :backoff | :stale | :ignored

  @type t :: %__MODULE__{
          state: state(),
          reason: term(),
          restarts: non_neg_integer(),
          retry_in_ms: non_neg_integer() | nil
        }

  use BB.Message,
    schema: [
      state: [type: {:in, @states}, required: true, doc: "One of the states above."],
      reason: [
        type: :any,
        default: nil,
        doc: "The reason why the component is down, from its driver; `nil` while it is up."
      ],
      restarts: [
        type: :non_neg_integer,
        default: 0,
        doc: "The number of restarts since the robot was started."
      ],
      retry_in_ms: [
        type: {:or, [:non_neg_integer, nil]},
        default: nil,
        doc: "The time until the restart, in milliseconds; `nil` if none is due."
      ]
    ]
end

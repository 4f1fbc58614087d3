defmodule BB.Message.Sensor.Status do
  @moduledoc """
  How a sensor fares, published on `[:sensor_status | path]` at each change.

  The states:

    * `:up` - it runs
    * `:backoff` - it went down, for `reason`, and is started again in `retry_in_ms` milliseconds
    * `:stale` - it runs, but has published or carried nothing for longer than its `max_silence`
    * `:ignored` - it declined to start (`:ignore`), and is not started again
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
        doc: "Why it is down, as its driver says; `nil` when it is up."
      ],
      restarts: [
        type: :non_neg_integer,
        default: 0,
        doc: "How often it was started again since the robot was started."
      ],
      retry_in_ms: [
        type: {:or, [:non_neg_integer, nil]},
        default: nil,
        doc: "When it is started again, in milliseconds from now; `nil` when it need not be."
      ]
    ]
end

defmodule BB.Ring.Message do
  @moduledoc """
  One message of a topic.

    * `sequence`: its number on the topic, from 0; a gap means lost messages
    * `timestamp_ns`: when it was published, on the ring's clock (`BB.Ring.now_ns/0`)
    * `data`: the bytes; they stay what they are
    * `lost`: how many messages this subscriber lost since the one before
  """

  @enforce_keys [:sequence, :timestamp_ns, :data]
  defstruct [:sequence, :timestamp_ns, :data, lost: 0]

  @type t :: %__MODULE__{
          sequence: non_neg_integer(),
          timestamp_ns: non_neg_integer(),
          data: binary(),
          lost: non_neg_integer()
        }
end

defmodule BB.Ring.Message do
  @moduledoc """
  One message of a topic, as a subscriber receives it.

  `BB.Ring.Subscriber` sends or returns it:

      {:ok, %BB.Ring.Message{data: data, lost: 0}} = BB.Ring.Subscriber.recv(subscriber)

  ## Fields

    * `:sequence` - its number on the topic, from 0; a gap means lost messages
    * `:timestamp_ns` - the time of its publication on the ring's clock (`BB.Ring.now_ns/0`)
    * `:data` - the bytes, which never change
    * `:lost` - the number of messages that this subscriber lost since the message before
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

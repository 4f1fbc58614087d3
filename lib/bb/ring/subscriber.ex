defmodule BB.Ring.Subscriber do
  @schema BB.Options.new!(
            active: [
              type: {:custom, BB.Ring.Subscriber, :check_active, []},
              default: false,
              doc: "The delivery at first, as `active/2` sets it later."
            ],
            start: [
              type:
                {:or, [{:in, [:new, :latest]}, {:tuple, [{:in, [:history]}, {:in, 1..65_536}]}]},
              default: :new,
              doc: """
              The first message: the next `:new` one, the `:latest` existing one, or the oldest \
              of the last `n` that the ring still holds (`{:history, n}`).
              """
            ],
            policy: [
              type: {:in, [:all, :latest]},
              default: :all,
              doc: """
              `:all` messages in order, or only the `:latest` one at each read. The field `lost` \
              counts those that are skipped.
              """
            ],
            guard: [
              type: {:in, [:auto, :always, :never]},
              default: :auto,
              doc: """
              Guarded reading: a file that another process truncates is an error, where it would \
              kill the VM (SIGBUS) otherwise. It costs a few system calls a message. `:auto` \
              guards topics of another user who is not trusted (`BB.Ring`); their files are not \
              mapped, and are read every few milliseconds. `:never` trusts the owner of any \
              file.
              """
            ],
            content: [
              type: :string,
              doc: """
              Name of the encoding that the messages must have, such as `"sensor_msgs/msg/Imu"`. \
              Messages of a topic with another content are not delivered, and the owner receives \
              an error. Without it any content is delivered.
              """
            ],
            untagged: [
              type: :boolean,
              default: false,
              doc: "With `content`: whether to accept a topic without a content tag too."
            ]
          )

  @moduledoc """
  A subscriber of a topic.

  Open one to read messages that programs in other languages publish:

      {:ok, subscriber} = BB.Ring.Subscriber.open("scan", content: "sensor_msgs/msg/LaserScan")
      {:ok, %BB.Ring.Message{data: bytes}} = BB.Ring.Subscriber.recv(subscriber)

  A subscriber may be opened before its topic exists. It attaches when the topic appears, and
  again when a publisher returns with a new file. Like a port, it belongs to the process that
  opened it: that process receives its messages, and the subscription ends with that process or by
  `close/1`.

  ## Active

  As with sockets (`:inet`), the owner sets how many messages are sent to it:

    * `true` - every message. The owner must keep up, since its mailbox has no limit
    * `:once` - one
    * `n` - that many more, in addition to those that remain; after the last one follows
      `{:bb_ring_passive, ref}`
    * `false` - none; `recv/2` returns the next one

  While the owner accepts no message, the ring continues to overwrite, and lost messages are
  counted. So the memory in use never exceeds the credits times the slot size.

  ## Messages to the owner

  | message | meaning |
  |---|---|
  | `{:bb_ring, ref, %BB.Ring.Message{}}` | a message |
  | `{:bb_ring_passive, ref}` | the credits are used up |
  | `{:bb_ring, ref, :publisher_up}`, `{:bb_ring, ref, :publisher_down}` | the topic has a live publisher now, or no longer has one |
  | `{:bb_ring, ref, {:error, reason}}` | attaching failed (`BB.Ring`); sent once, while attaching is retried |
  | `{:bb_ring, ref, {:error, {:other_content, tag}}}` | the topic now has another content than `content`; no message of it is delivered |

  ## Options

  #{BB.Options.docs(@schema)}
  """

  alias BB.Ring.{Message, Native, Trust}

  @enforce_keys [:handle, :ref, :topic]
  defstruct [:handle, :ref, :topic]

  @type t :: %__MODULE__{handle: reference(), ref: reference(), topic: String.t()}
  @type active :: boolean() | :once | integer()

  @doc "Subscribes the calling process to `topic`, which need not exist yet."
  @spec open(String.t(), keyword()) :: {:ok, t()} | {:error, BB.Ring.reason()}
  def open(topic, opts \\ []) do
    topic = BB.Ring.check_found_topic!(topic)
    opts = BB.Options.validate!(opts, @schema)
    ref = make_ref()
    Trust.apply!()

    with {:ok, handle} <- Native.subscriber_open(topic, ref, native_options(opts)) do
      subscriber = %__MODULE__{handle: handle, ref: ref, topic: topic}
      _ = active(subscriber, opts[:active])
      {:ok, subscriber}
    end
  end

  @doc "Sets how many messages are sent to the owner."
  @spec active(t(), active()) :: :ok | {:error, :closed}
  def active(%__MODULE__{handle: handle, ref: ref}, active) do
    case Native.subscriber_active(handle, native_active!(active)) do
      :ok -> :ok
      :passive -> send_passive(ref)
      :closed -> {:error, :closed}
    end
  end

  @doc """
  Returns the next message of a passive subscriber, waiting for it up to `timeout` milliseconds.

  Returns `{:error, :active}` when messages are sent to the owner.
  """
  @spec recv(t(), timeout()) :: {:ok, Message.t()} | {:error, :timeout | :closed | :active}
  def recv(subscriber, timeout \\ :infinity)

  def recv(%__MODULE__{handle: handle, ref: ref}, timeout)
      when timeout == :infinity or (is_integer(timeout) and timeout >= 0) do
    with {:ok, id} <- Native.subscriber_request(handle, :next) do
      receive do
        {:bb_ring_reply, ^ref, ^id, result} -> result
      after
        timeout -> cancel(handle, ref, id)
      end
    end
  end

  def recv(%__MODULE__{}, timeout) do
    raise ArgumentError,
          "expected a timeout in milliseconds or :infinity, got: #{inspect(timeout)}"
  end

  @doc """
  Returns the newest message that was not read yet.

  Messages before it are skipped, and counted as lost. Without a new message it returns
  `{:error, :empty}`.
  """
  @spec latest(t()) :: {:ok, Message.t()} | {:error, :empty | :closed}
  def latest(%__MODULE__{handle: handle, ref: ref}) do
    with {:ok, id} <- Native.subscriber_request(handle, :latest) do
      receive do
        {:bb_ring_reply, ^ref, ^id, result} -> result
      end
    end
  end

  @doc """
  Calls `fun` with the newest message that was not read yet, without copying the message.

  Returns `{:ok, result}` with the result of `fun`.

      {:ok, brightness} =
        BB.Ring.Subscriber.with_frame(subscriber, fn message ->
          <<_header::binary-44, pixels::binary>> = message.data
          brightness(pixels)
        end)

  Use it for large messages, such as camera frames. Messages before the newest are skipped and
  counted as lost, as by `latest/1`. A message of up to 64 KiB is copied, which costs less than a
  lease.

  ## The lease

  While `fun` runs, the publisher does not overwrite the message's slot. The publisher does not
  wait either: when it comes round to that slot it skips it, which costs the other subscribers one
  number in each lap (`lost`, and `dropped_pinned` in `BB.Ring.info/1`, which also shows the
  holder). So `fun` should take less time than the topic's period times the number of slots less
  one.

  The slot is released when `fun` returns or raises, or when the process exits. `message.data` and
  its parts may be kept, returned or sent; like any binary they never change. A part that is kept
  is copied when `fun` ends, which costs several times as much as `latest/1`. To find kept parts,
  the calling process is garbage-collected first if its heap is smaller than the message. So call
  this function from a process with a small heap, and return computed values rather than parts of
  the frame.

  ## Errors

    * `:empty` - no new message
    * `:too_many_leases` - three frames of this subscriber are lent already, to other processes or
      around this call
    * `:closed`

  A message of a publisher without leases (a legacy one), or of another user, is copied.
  """
  @spec with_frame(t(), (Message.t() -> result)) ::
          {:ok, result} | {:error, :empty | :too_many_leases | :closed}
        when result: term()
  def with_frame(%__MODULE__{handle: handle, ref: ref}, fun) when is_function(fun, 1) do
    with {:ok, id} <- Native.subscriber_request(handle, :frame) do
      receive do
        {:bb_ring_reply, ^ref, ^id, {:ok, %Message{} = copy}} -> {:ok, fun.(copy)}
        {:bb_ring_reply, ^ref, ^id, {:ok, lease}} -> lend(lease, Native.lease_message(lease), fun)
        {:bb_ring_reply, ^ref, ^id, {:error, reason}} -> {:error, reason}
      end
    end
  end

  @doc """
  Ends the subscription.

  No message of it is sent after this function returns. Those in the caller's mailbox are removed.
  """
  @spec close(t()) :: :ok
  def close(%__MODULE__{handle: handle, ref: ref}) do
    if Native.subscriber_close(handle) do
      receive do
        {:bb_ring_closed, ^ref} -> :ok
      end
    end

    flush(ref)
  end

  @doc false
  def check_active(active)
      when is_boolean(active) or active == :once or active in -32_768..32_767,
      do: {:ok, active}

  def check_active(other) do
    {:error,
     "expected true, false, :once or a number from -32768 to 32767, got: #{inspect(other)}"}
  end

  defp native_options(opts) do
    opts
    |> Keyword.take([:start, :policy, :guard, :untagged])
    |> Map.new()
    |> Map.put(:content, opts[:content])
  end

  defp send_passive(ref) do
    send(self(), {:bb_ring_passive, ref})
    :ok
  end

  # No variable may refer to the message once `fun` has it: the message would count as kept.
  defp lend(lease, message, fun) do
    size = byte_size(message.data)

    try do
      {:ok, fun.(message)}
    after
      release(lease, size)
    end
  end

  defp release(lease, size) do
    Native.lease_release(lease) || (collect(size) && Native.lease_release(lease)) ||
      Native.lease_detach(lease)
  end

  # Collecting a heap that is larger than the message costs more than copying the message.
  defp collect(size) do
    {:total_heap_size, words} = Process.info(self(), :total_heap_size)

    if words * :erlang.system_info(:wordsize) <= size do
      :erlang.garbage_collect()
      # The scheduler frees the binary between two processes.
      :erlang.yield()
    end
  end

  # A reply may already be on its way. It is received, so that no message is lost.
  defp cancel(handle, ref, id) do
    if Native.subscriber_cancel(handle, id) do
      {:error, :timeout}
    else
      receive do
        {:bb_ring_reply, ^ref, ^id, result} -> result
      end
    end
  end

  defp native_active!(active) do
    case check_active(active) do
      {:ok, true} -> :always
      {:ok, false} -> :never
      {:ok, :once} -> :once
      {:ok, more} -> {:more, more}
      {:error, message} -> raise ArgumentError, message
    end
  end

  defp flush(ref) do
    receive do
      {:bb_ring, ^ref, _} -> flush(ref)
      {:bb_ring_passive, ^ref} -> flush(ref)
    after
      0 -> :ok
    end
  end
end

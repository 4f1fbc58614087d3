defmodule BB.Ring.Subscriber do
  @schema BB.Options.new!(
            active: [
              type: {:custom, BB.Ring.Subscriber, :check_active, []},
              default: false,
              doc: "Delivery from the start, as `active/2` sets it."
            ],
            start: [
              type:
                {:or, [{:in, [:new, :latest]}, {:tuple, [{:in, [:history]}, {:in, 1..65_536}]}]},
              default: :new,
              doc:
                "Where to begin: `:new` messages only, the `:latest` one that there is, or `{:history, n}`: the last `n` that the ring still has."
            ],
            policy: [
              type: {:in, [:all, :latest]},
              default: :all,
              doc:
                "`:all` messages in order, or only the `:latest` at each read; those skipped are counted in `lost`."
            ],
            guard: [
              type: {:in, [:auto, :always, :never]},
              default: :auto,
              doc:
                "Guarded reading: a file that another process cuts off is an error then, where it would kill the VM (SIGBUS). Costs a few system calls a message. `:auto`: of topics that belong to another user, who is not trusted (see `BB.Ring`); these are not even mapped, and looked at every few milliseconds. `:never` trusts whoever owns the file."
            ],
            content: [
              type: :string,
              doc:
                "Name of the encoding that the messages must have, such as `\"sensor_msgs/msg/Imu\"`. " <>
                  "Messages of a topic with another content are not delivered, and the owner is told. " <>
                  "None: whatever the topic has."
            ],
            untagged: [
              type: :boolean,
              default: false,
              doc: "With `content`: takes a topic too that does not say what its messages are."
            ]
          )

  @moduledoc """
  The reading end of a topic.

  A subscriber may be opened before its topic exists; it attaches when the topic appears, and again when the publisher came back with a new
  file. As a port, it belongs to the process that opened it: its messages go there,
  and it ends with that process or by `close/1`.

  ## Active

  As with sockets (`:inet`), the owner says how many messages it wants to be sent:

    * `true`: every message. The owner must keep up, its mailbox has no bound
    * `:once`: one
    * `n`: so many more, on top of those that are left; when the last one was sent, `{:bb_ring_passive, ref}` follows
    * `false`: none; ask for each with `recv/2`

  While no message is wanted the ring goes on overwriting, and what is lost is counted: the memory in use never exceeds the credits times the slot size.

  ## Messages to the owner

  | message | meaning |
  |---|---|
  | `{:bb_ring, ref, %BB.Ring.Message{}}` | a message |
  | `{:bb_ring_passive, ref}` | the credits are used up |
  | `{:bb_ring, ref, :publisher_up}`, `{:bb_ring, ref, :publisher_down}` | the topic has a live publisher now, or has none any more |
  | `{:bb_ring, ref, {:error, reason}}` | attaching failed (see `BB.Ring`); told once, tried again by itself |
  | `{:bb_ring, ref, {:error, {:other_content, tag}}}` | the topic has another content than `content` now; nothing of it is delivered |

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

    with {:ok, handle} <-
           Native.subscriber_open(
             topic,
             ref,
             native_options(opts)
           ) do
      subscriber = %__MODULE__{handle: handle, ref: ref, topic: topic}
      _ = active(subscriber, opts[:active])
      {:ok, subscriber}
    end
  end

  @doc "Sets how many messages the owner gets."
  @spec active(t(), active()) :: :ok | {:error, :closed}
  def active(%__MODULE__{handle: handle, ref: ref}, active) do
    case Native.subscriber_active(handle, native_active!(active)) do
      :ok -> :ok
      :passive -> tell_passive(ref)
      :closed -> {:error, :closed}
    end
  end

  @doc """
  The next message of a passive subscriber, waiting for it up to `timeout` milliseconds.

  `{:error, :active}` when messages go to the owner by themselves.
  """
  @spec recv(t(), timeout()) :: {:ok, Message.t()} | {:error, :timeout | :closed | :active}
  def recv(subscriber, timeout \\ :infinity)

  def recv(%__MODULE__{handle: handle, ref: ref}, timeout)
      when timeout == :infinity or (is_integer(timeout) and timeout >= 0) do
    with {:ok, id} <- Native.subscriber_request(handle, :next) do
      receive do
        {:bb_ring_reply, ^ref, ^id, result} -> result
      after
        timeout -> take_back(handle, ref, id)
      end
    end
  end

  def recv(%__MODULE__{}, timeout) do
    raise ArgumentError,
          "a timeout is a number of milliseconds or :infinity, got: #{inspect(timeout)}"
  end

  @doc "The newest message that was not read yet; those before it are skipped, and counted as lost. `{:error, :empty}` when there is none."
  @spec latest(t()) :: {:ok, Message.t()} | {:error, :empty | :closed}
  def latest(%__MODULE__{handle: handle, ref: ref}) do
    with {:ok, id} <- Native.subscriber_request(handle, :latest) do
      receive do
        {:bb_ring_reply, ^ref, ^id, result} -> result
      end
    end
  end

  @doc """
  Lends `fun` the newest message that was not read yet, without copying it: `{:ok, what_fun_returned}`.

      {:ok, brightness} =
        BB.Ring.Subscriber.with_frame(subscriber, fn %BB.Ring.Message{data: <<_header::binary-44, pixels::binary>>} ->
          brightness(pixels)
        end)

  For large messages, as camera frames are: those before the newest are skipped and counted as lost, as by `latest/1`. Up to 64 KiB a
  message is copied, which costs less than to lend it.

  While `fun` runs, the publisher leaves the message's slot alone. It waits for nobody and stops for nobody: once it has gone round the ring it
  passes that slot over, which costs the other subscribers one number in each lap (`lost`, and `dropped_pinned` in `BB.Ring.info/1`, which also
  tells who holds). So `fun` should take less time than the ring has slots, less one, times the topic's period.

  The slot is given back when `fun` returns or raises, or when the process dies. `message.data` and its parts may be kept, returned or sent: they
  never change, like any binary. What is kept is copied at the end, which costs several times as much as `latest/1`. To learn whether something is, the calling
  process is garbage-collected first if its heap is smaller than the message. So call this from a process with a small heap, and take
  what `fun` needs out of the frame rather than parts of it.

  Errors: `:empty` when there is no new message; `:too_many_leases` when three frames of this subscriber are lent already (to other processes
  or around this call); `:closed`.

  A topic whose publisher does not know of leases (a legacy one), or runs as another user, is copied instead.
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

  @doc "Ends the subscription. No message of it comes after this returns; those of the caller's mailbox are removed."
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

  defp tell_passive(ref) do
    send(self(), {:bb_ring_passive, ref})
    :ok
  end

  # Nothing here may refer to the message once `fun` has it: it would count as kept.
  defp lend(lease, message, fun) do
    size = byte_size(message.data)

    try do
      {:ok, fun.(message)}
    after
      give_back(lease, size)
    end
  end

  defp give_back(lease, size) do
    Native.lease_release(lease) || (collect(size) && Native.lease_release(lease)) ||
      Native.lease_detach(lease)
  end

  # A heap that is larger than the message costs more to collect than the message to copy.
  defp collect(size) do
    {:total_heap_size, words} = Process.info(self(), :total_heap_size)

    if words * :erlang.system_info(:wordsize) <= size do
      :erlang.garbage_collect()
      # The scheduler tells the binary's owner of its end between two processes.
      :erlang.yield()
    end
  end

  # The answer may be on its way: it is taken, lest a message be lost.
  defp take_back(handle, ref, id) do
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

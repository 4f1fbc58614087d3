defmodule BB.Ring.Publisher do
  @schema BB.Options.new!(
            slot_count: [
              type: {:custom, BB.Ring.Publisher, :check_slot_count, []},
              default: 16,
              doc: """
              Number of slots: a power of two up to 1048576. Set either this and `slot_size`, or \
              `depth` and `max_message_size`.
              """
            ],
            slot_size: [
              type: {:in, 21..0x4000_0000},
              default: 4096,
              doc: """
              Bytes of a slot, including its header of 20 bytes. The file rounds it up to a \
              multiple of 64, but a message of more than `slot_size` - 20 bytes is too large.
              """
            ],
            depth: [
              type: {:in, 1..1_048_576},
              doc: "Number of messages that the topic holds, rounded up to a power of two."
            ],
            max_message_size: [
              type: {:in, 1..0x3FFF_FFEC},
              doc: "Bytes of the longest message, without the slot's header."
            ],
            content: [
              type: :string,
              doc: """
              Name of the encoding, such as `"sensor_msgs/msg/Imu"`, by which tools decode the \
              messages. Without it the messages are raw bytes.
              """
            ],
            mode: [type: {:in, 0..0o777}, default: 0o660, doc: "Permissions of the file."],
            force: [
              type: :boolean,
              default: false,
              doc: """
              Whether to replace a file of a publisher without our extension, which may be in use.
              """
            ]
          )

  @moduledoc """
  The publisher of a topic.

  Open one to write messages that programs in other languages read:

      {:ok, publisher} = BB.Ring.Publisher.open("scan", content: "sensor_msgs/msg/LaserScan")
      :ok = BB.Ring.Publisher.publish(publisher, bytes)

  A topic has one publisher at a time, in any process of the machine. Any process of the VM may
  publish through it.

  ## The owner

  Like a port, a publisher belongs to the process that opened it. When that process exits, the
  topic stays, and the next publisher continues it in place. `close/1` ends the topic.

  When the topic's file is removed, or another file takes its name, the publisher makes the file
  again within a second, with the same messages and the same sequence number, and the subscribers
  follow. The owner receives `{:bb_ring_publisher, topic, :renewed}`. When that fails, because
  another publisher or another user has the name, the owner receives `{:bb_ring_publisher, topic,
  {:error, reason}}` once, and `publish/2` returns that error until the name is free again.

  ## Options

  #{BB.Options.docs(@schema)}
  """

  alias BB.Ring.{Native, Trust}

  # Up to this size copying a message is faster than moving to a dirty scheduler.
  @normal_limit 65_536

  @enforce_keys [:handle, :topic]
  defstruct [:handle, :topic]

  @opaque t :: %__MODULE__{handle: reference(), topic: String.t()}

  @doc """
  Opens a topic for writing.

  After a publisher that died, it continues in place when the slots are the same. When they
  differ, it retires the old file, and the subscribers follow to the new one. With a live
  publisher it returns `{:error, {:publisher_alive, os_pid}}`; `BB.Ring` lists all reasons.
  """
  @spec open(String.t(), keyword()) :: {:ok, t()} | {:error, BB.Ring.reason()}
  def open(topic, opts \\ []) do
    topic = BB.Ring.check_topic!(topic)
    options = native_options(opts)
    Trust.apply!()

    with {:ok, handle} <- Native.publisher_open(topic, options) do
      {:ok, %__MODULE__{handle: handle, topic: topic}}
    end
  end

  @doc """
  Publishes one message.

  Returns `:ok` or

    * `{:error, :message_too_large}` - nothing was written
    * `{:error, :slot_held}` - subscribers hold all slots (`BB.Ring.Subscriber.with_frame/2`); the
      message is dropped and counted
    * `{:error, :closed}`
    * `{:error, reason}` - the topic has lost its name, as above

  The bytes of `iodata` are gathered directly into the slot. A message of more than 64 KiB is
  copied on a dirty scheduler.
  """
  @spec publish(t(), iodata()) :: :ok | {:error, BB.Ring.reason()}
  def publish(%__MODULE__{handle: handle} = publisher, data)
      when is_binary(data) and byte_size(data) <= @normal_limit do
    case Native.publish_binary(handle, data) do
      :ok -> :ok
      :busy -> yield_and(fn -> publish(publisher, data) end)
      :name_lost -> handle_lost_name(publisher, data)
      reason -> {:error, reason}
    end
  end

  def publish(%__MODULE__{handle: handle} = publisher, data) do
    iovec = :erlang.iolist_to_iovec(data)

    case publish_iovec(handle, iovec, :erlang.iolist_size(iovec)) do
      :ok -> :ok
      :busy -> yield_and(fn -> publish(publisher, iovec) end)
      :name_lost -> handle_lost_name(publisher, iovec)
      reason -> {:error, reason}
    end
  end

  @doc "Ends the topic: notifies its subscribers and removes its file."
  @spec close(t()) :: :ok
  def close(%__MODULE__{handle: handle} = publisher) do
    case Native.publisher_close(handle) do
      :busy -> yield_and(fn -> close(publisher) end)
      _closed -> :ok
    end
  end

  @doc "Returns the state of the topic."
  @spec info(t()) :: {:ok, BB.Ring.info()} | {:error, :closed}
  def info(%__MODULE__{handle: handle} = publisher) do
    case Native.publisher_info(handle) do
      {:error, :busy} -> yield_and(fn -> info(publisher) end)
      result -> result
    end
  end

  @doc false
  def check_slot_count(value) when is_integer(value) and value in 1..1_048_576 do
    if Bitwise.band(value, value - 1) == 0, do: {:ok, value}, else: slot_count_error(value)
  end

  def check_slot_count(value), do: slot_count_error(value)

  defp slot_count_error(value),
    do: {:error, "expected a power of two from 1 to 1048576, got: #{inspect(value)}"}

  defp publish_iovec(handle, iovec, size) when size <= @normal_limit,
    do: Native.publish_iovec(handle, iovec)

  defp publish_iovec(handle, iovec, _size), do: Native.publish_large(handle, iovec)

  defp handle_lost_name(%__MODULE__{handle: handle} = publisher, data) do
    case Native.publisher_trouble(handle) do
      {:error, :busy} -> yield_and(fn -> handle_lost_name(publisher, data) end)
      {:error, reason} -> {:error, reason}
      # The name is free again.
      :ok -> publish(publisher, data)
    end
  end

  # Another process is publishing on this ring. It runs while this one yields.
  defp yield_and(retry) do
    :erlang.yield()
    retry.()
  end

  defp native_options(opts) do
    checked = BB.Options.validate!(opts, @schema)
    {count, size} = slots!(opts, checked)

    %{
      slot_count: count,
      slot_size: size,
      content: checked[:content],
      mode: checked[:mode],
      force: checked[:force]
    }
  end

  defp slots!(given, checked) do
    case {checked[:depth], checked[:max_message_size], given[:slot_count] || given[:slot_size]} do
      {nil, nil, _} ->
        {checked[:slot_count], checked[:slot_size]}

      {depth, size, nil} when depth != nil and size != nil ->
        {power_of_two(depth), size + 20}

      _ ->
        raise ArgumentError,
              "expected slot_count and slot_size, or depth and max_message_size, " <>
                "got: #{inspect(given)}"
    end
  end

  defp power_of_two(n, power \\ 1)
  defp power_of_two(n, power) when power >= n, do: power
  defp power_of_two(n, power), do: power_of_two(n, power * 2)
end

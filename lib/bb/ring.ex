defmodule BB.Ring do
  @moduledoc """
  Topics in shared memory, between the BEAM and native processes.

  Use the ring for large or frequent messages to or from a program in another language. A topic is
  a ring of slots in `/dev/shm/conduit_<topic>` with one publisher and up to sixteen subscribers,
  in any process and language. `BB.Ring.Publisher` writes a topic, `BB.Ring.Subscriber` reads it.

      {:ok, publisher} = BB.Ring.Publisher.open("scan", slot_count: 16, slot_size: 4096)
      {:ok, subscriber} = BB.Ring.Subscriber.open("scan", active: true)
      :ok = BB.Ring.Publisher.publish(publisher, "hello")

      receive do
        {:bb_ring, ref, %BB.Ring.Message{data: "hello"}} when ref == subscriber.ref -> :ok
      end

  ## Guarantees

    * **A publisher never waits for a reader.** A reader that falls behind by more than the ring
      holds loses the oldest messages, and the field `lost` of each message counts those lost
      before it.
    * **No message is torn.** A message that was half-written when its publisher was killed is
      never delivered.
    * **A topic outlives its publisher.** The next publisher continues in place, with the next
      sequence number, and subscribers of any language stay attached.
    * **No call blocks a scheduler**, and no bytes that another process writes into the ring can
      crash the VM.

  ## When not to use it

  For small topics that only BEAM processes use, `BB.PubSub` needs no copy into shared memory. For
  messages that must not be lost, use a queue: a ring keeps the newest messages, not all.

  ## Other users' files

  The owner of a file can truncate it at any moment, which kills every program that has it mapped,
  and any user can create a file in `/dev/shm` under the name of a topic. So a file of another
  user is never mapped: a publisher refuses it, a subscriber reads it guarded
  (`BB.Ring.Subscriber`), and `info/1` maps no file. Native programs that run as other users are
  trusted by name or number:

      config :ganglion, BB.Ring, trusted_users: ["vision", 1001], trusted_groups: ["robot"]

  To trust the VM's user, set `CONDUIT_RING_TRUSTED_UIDS` in the environment of these programs. It
  and `CONDUIT_RING_TRUSTED_GIDS` are lists of numbers or names, separated by commas. The VM reads
  them too.

  ## Errors

  A topic's name is 1 to 200 characters out of `A-Z a-z 0-9 _ . -`. A topic of another name, which
  a program with other rules has made ("cam 1", "front:rgb"), can be read, but not published.

  A wrong topic name or option raises `ArgumentError` or `BB.Options.ValidationError`. A failure
  of the system returns `{:error, reason}`, which `format_error/1` formats:

  | reason | meaning |
  |---|---|
  | `{:publisher_alive, os_pid}` | the topic has a live publisher; `os_pid` is 0 when its number is unknown |
  | `{:legacy_topic, path}` | a publisher without our extension made the file, which may be in use |
  | `{:foreign_owner, path, uid, name}` | the file belongs to a user who is not trusted; `name` may be nil |
  | `{:not_a_ring, path, text}` | the file is no ring, or a broken one |
  | `{:no_topic, path}` | the topic does not exist (only from `info/1`; a subscriber waits for it) |
  | `{:no_reader_slot, path}` | sixteen subscribers are attached already |
  | `{:system, path, operation, errno}` | the operating system refused `operation`; `errno` is a number (`BB.Errno`) |
  | `{:thread, text}` | the operating system refused to start a thread |
  | `{:other_content, tag}` | the topic has another content than the subscriber's; 0 for no content |
  | `:closed` | the publisher or subscriber was closed, or its owner has exited |
  | `:message_too_large` | the message is longer than the topic's slots |
  | `:slot_held` | subscribers hold all slots, and the message was dropped |
  """

  alias BB.Ring.{Native, Trust}

  # ENOSPC
  @no_space 28

  @typedoc "The reason of an error; the table above explains each."
  @type reason ::
          {:publisher_alive, os_pid :: non_neg_integer()}
          | {:legacy_topic, Path.t()}
          | {:foreign_owner, Path.t(), uid :: non_neg_integer(), name :: String.t() | nil}
          | {:not_a_ring, Path.t(), String.t()}
          | {:no_topic, Path.t()}
          | {:no_reader_slot, Path.t()}
          | {:system, Path.t(), operation :: String.t(), errno :: integer()}
          | {:thread, String.t()}
          | {:other_content, tag :: non_neg_integer()}
          | :closed
          | :message_too_large
          | :slot_held

  @typedoc """
  The state of a topic.

  `published` is the number of messages so far, and so the next sequence number. `readers` are the
  subscribers that are attached now.
  """
  @type info :: %{
          topic: String.t(),
          slot_count: pos_integer(),
          slot_size: pos_integer(),
          max_message_size: pos_integer(),
          published: non_neg_integer(),
          state: :live | :dead | :closed | :retired | :legacy | :unknown,
          epoch: non_neg_integer(),
          writer_pid: non_neg_integer(),
          last_publish_ns: non_neg_integer(),
          readers: [reader()],
          rejected_oversize: non_neg_integer(),
          dropped_pinned: non_neg_integer(),
          wake_count: non_neg_integer()
        }

  @typedoc """
  A subscriber that is attached to a topic.

    * `native` - whether it has our extension; of one without, only `index` and `next_sequence`
      are known
    * `alive` - `false` when it was killed; its place goes to the next subscriber that needs one
    * `leases`, `held` - how many messages it holds in their slots now, and their sequence
      numbers. A held message that is `slot_count` or more behind `published` costs the topic one
      number in each lap
  """
  @type reader :: %{
          index: 0..15,
          os_pid: non_neg_integer(),
          native: boolean(),
          alive: boolean(),
          next_sequence: non_neg_integer(),
          lost: non_neg_integer(),
          leases: 0..3,
          held: [non_neg_integer()]
        }

  @doc "Returns the state of a topic without attaching to it."
  @spec info(String.t()) :: {:ok, info()} | {:error, reason()}
  def info(topic) do
    topic = check_found_topic!(topic)
    Trust.apply!()
    Native.topic_info(topic)
  end

  @doc """
  Returns the content tag of an encoding's name, as a topic carries it.

      iex> BB.Ring.content_tag("sensor_msgs/msg/Imu") == BB.Ring.content_tag("my_msgs/msg/Imu")
      false
  """
  @spec content_tag(String.t()) :: non_neg_integer()
  def content_tag(name) when is_binary(name), do: Native.content_tag(name)

  @doc """
  Returns the time of the ring's clock (CLOCK_MONOTONIC_RAW) in nanoseconds.

  It is comparable with the `timestamp_ns` of any message.
  """
  @spec now_ns() :: non_neg_integer()
  def now_ns, do: Native.now_ns()

  @doc """
  Converts a time of the ring's clock to Erlang's monotonic time, both in nanoseconds.
  """
  @spec to_monotonic_time(non_neg_integer()) :: integer()
  def to_monotonic_time(timestamp_ns) do
    System.monotonic_time(:nanosecond) - (Native.now_ns() - timestamp_ns)
  end

  @doc """
  Formats the reason of an error.

      iex> BB.Ring.format_error(:message_too_large)
      "the message is longer than a slot of the topic; open the publisher with a larger slot_size"
  """
  @spec format_error(term()) :: String.t()
  def format_error({:publisher_alive, pid}) do
    process = if pid == 0, do: "", else: " (process #{pid})"
    "the topic has a live publisher#{process}; end it, or publish on another topic"
  end

  def format_error({:legacy_topic, path}) do
    "#{path} belongs to a publisher without the extension and may be in use; " <>
      "end that publisher and remove the file, or publish on another topic"
  end

  def format_error({:foreign_owner, path, uid, name}) do
    owner = if name, do: "#{uid} (#{name})", else: "#{uid}"

    "#{path} belongs to user #{owner}, who is not trusted: remove the file, publish as that " <>
      "user, or trust the user: config :ganglion, BB.Ring, trusted_users: [#{uid}]"
  end

  def format_error({:not_a_ring, path, text}), do: "#{path} is not a usable ring: #{text}"

  def format_error({:no_topic, path}),
    do: "topic #{path} does not exist; start its publisher, or correct the name"

  def format_error({:no_reader_slot, path}),
    do: "#{path} has 16 subscribers, and no place for another; close one of them"

  def format_error({:system, path, operation, @no_space}),
    do:
      "#{path}: #{operation} failed: no space left in #{Path.dirname(path)}; " <>
        "remove topics that are not in use, or mount it with a larger size"

  def format_error({:system, path, operation, errno}),
    do: "#{path}: #{operation} failed: #{BB.Errno.message(errno)}"

  def format_error({:other_content, 0}) do
    "expected a topic with the subscriber's content, got: no content tag; " <>
      "set `content` at the publisher, or open the subscriber without it"
  end

  def format_error({:other_content, tag}) do
    "expected a topic with the subscriber's content, got: the content tag #{hex(tag)}; " <>
      "correct the topic, or `content` at the publisher or the subscriber"
  end

  def format_error({:thread, text}), do: "could not start a thread: #{text}"
  def format_error(:closed), do: "the publisher or subscriber is closed"

  def format_error(:message_too_large),
    do:
      "the message is longer than a slot of the topic; open the publisher with a larger slot_size"

  def format_error(:slot_held) do
    "subscribers hold all slots of the topic; release their messages, or open the publisher " <>
      "with a larger slot_count"
  end

  def format_error(reason), do: inspect(reason)

  defp hex(tag), do: "0x" <> (tag |> Integer.to_string(16) |> String.pad_leading(16, "0"))

  @doc false
  defdelegate check_topic(topic), to: BB.Topic, as: :check

  @doc false
  defdelegate check_found_topic(topic), to: BB.Topic, as: :check_found

  @doc false
  def check_topic!(topic), do: topic |> check_topic() |> ok!()

  @doc false
  def check_found_topic!(topic), do: topic |> check_found_topic() |> ok!()

  defp ok!(checked) do
    case checked do
      {:ok, topic} -> topic
      {:error, message} -> raise ArgumentError, message
    end
  end
end

defmodule BB.Ring do
  @moduledoc """
  Shared-memory topics between the BEAM and native processes.

  A topic is a ring of slots in `/dev/shm/conduit_<topic>` with one publisher and up to sixteen subscribers, in any process and
  language. `BB.Ring.Publisher` writes one, `BB.Ring.Subscriber` reads one.

      {:ok, publisher} = BB.Ring.Publisher.open("scan", slot_count: 16, slot_size: 4096)
      {:ok, subscriber} = BB.Ring.Subscriber.open("scan", active: true)
      :ok = BB.Ring.Publisher.publish(publisher, "hello")

      receive do
        {:bb_ring, ref, %BB.Ring.Message{data: "hello"}} when ref == subscriber.ref -> :ok
      end

  What to rely on:

    * **A publisher never waits for a reader.** A reader that falls behind by more than the ring holds loses the oldest messages,
      and each message that it gets says how many were lost before it (`lost`).
    * **No message is ever torn**, and none that was half-written when its publisher was killed is ever seen.
    * **A publisher that dies** leaves its topic behind. The next one goes on in place, with the next sequence number; subscribers
      of any language stay attached.
    * **Nothing here blocks a scheduler**, and nothing that another process writes into the ring can crash the VM.

  Not for many small topics that only BEAM processes use: `BB.PubSub` does that without a copy into shared memory. Not for
  messages that must not be lost: a ring keeps the newest, not all.

  ## Other users' files

  Whoever owns a file can cut it off at any moment, which ends every program that has it mapped, and anyone can make a file
  in `/dev/shm` under the name of a topic. So a file of another user is never mapped: a publisher refuses it, a subscriber
  reads it guarded (see `BB.Ring.Subscriber`), and `info/1` maps nothing at all. Native programs that run as users of their
  own are trusted by name or number:

      config :ganglion, BB.Ring, trusted_users: ["vision", 1001], trusted_groups: ["robot"]

  They in turn trust the user of the VM by their environment: `CONDUIT_RING_TRUSTED_UIDS=0`, which the VM reads too. It and
  `CONDUIT_RING_TRUSTED_GIDS` list numbers or names with commas between.

  ## Errors

  A topic's name is 1 to 200 characters out of `A-Z a-z 0-9 _ . -`. Topics that others made by other rules ("cam 1", "front:rgb") can
  be read and looked at, not published.

  A wrong topic name or option raises `ArgumentError` or `BB.Options.ValidationError`. The system's trouble is
  `{:error, reason}`; `format_error/1` puts it into words:

  | reason | meaning |
  |---|---|
  | `{:publisher_alive, os_pid}` | the topic has a live publisher; `os_pid` is 0 when it did not leave its number |
  | `{:legacy_topic, path}` | the file was made by a publisher without our extension, and may be in use |
  | `{:foreign_owner, path, uid, name}` | the file belongs to another user who is not trusted; `name` is nil when there is none |
  | `{:not_a_ring, path, text}` | the file is no ring, or a broken one |
  | `{:no_topic, path}` | there is no such topic (only `info/1` says so: a subscriber waits for it) |
  | `{:no_reader_slot, path}` | sixteen subscribers are attached already |
  | `{:system, path, operation, errno}` | the operating system refused `operation`; `errno` as a number, see `BB.Errno` |
  | `{:other_content, tag}` | the topic's messages have another content than a subscriber takes; 0 where the topic names none |
  | `:closed` | the publisher or subscriber was closed, or its owner has died |
  | `:message_too_large` | the message is longer than the topic's slots |
  | `:slot_held` | subscribers hold all slots, so that this message was dropped |
  """

  alias BB.Ring.{Native, Trust}

  # ENOSPC
  @no_space 28

  @typedoc "Why the system refused."
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
  A topic as it stands. `published` is the number of messages so far, and so the next sequence number; `readers` are the subscribers
  attached now, with what each has lost.
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
  A subscriber that is attached now. One that is not `native` is a legacy peer, of which only `index` and `next_sequence` are known; one that
  is not `alive` was killed, and its place goes to the next that needs it. `leases` is how many messages it holds in their slots now,
  and `held` their sequence numbers: one that is `slot_count` behind `published` or more costs the topic one number in each lap.
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

  @doc "Looks at a topic without attaching to it."
  @spec info(String.t()) :: {:ok, info()} | {:error, reason()}
  def info(topic) do
    topic = check_found_topic!(topic)
    Trust.apply!()
    Native.topic_info(topic)
  end

  @doc """
  The content tag of an encoding's name, as a topic carries it.

      iex> BB.Ring.content_tag("sensor_msgs/msg/Imu") == BB.Ring.content_tag("my_msgs/msg/Imu")
      false
  """
  @spec content_tag(String.t()) :: non_neg_integer()
  def content_tag(name) when is_binary(name), do: Native.content_tag(name)

  @doc "Now on the ring's clock (CLOCK_MONOTONIC_RAW), in nanoseconds: comparable with any message's `timestamp_ns`."
  @spec now_ns() :: non_neg_integer()
  def now_ns, do: Native.now_ns()

  @doc "The Erlang monotonic time, in nanoseconds, at which the ring's clock showed `timestamp_ns`."
  @spec to_monotonic_time(non_neg_integer()) :: integer()
  def to_monotonic_time(timestamp_ns) do
    System.monotonic_time(:nanosecond) - (Native.now_ns() - timestamp_ns)
  end

  @doc "A reason in words."
  @spec format_error(term()) :: String.t()
  def format_error({:publisher_alive, 0}), do: "the topic has a live publisher"
  def format_error({:publisher_alive, pid}), do: "the topic has a live publisher (process #{pid})"

  def format_error({:legacy_topic, path}),
    do: "#{path} belongs to a publisher without the extension and may be in use"

  def format_error({:foreign_owner, path, uid, name}) do
    owner = if name, do: "#{uid} (#{name})", else: "#{uid}"

    "#{path} belongs to user #{owner}, who is not trusted: remove the file, publish as that user, or " <>
      "trust the user: config :ganglion, BB.Ring, trusted_users: [#{uid}]"
  end

  def format_error({:not_a_ring, path, text}), do: "#{path} is not a usable ring: #{text}"
  def format_error({:no_topic, path}), do: "#{path}: there is no such topic"

  def format_error({:no_reader_slot, path}),
    do: "#{path} has 16 subscribers already, which is all it can have"

  def format_error({:system, path, operation, @no_space}),
    do:
      "#{path}: #{operation} failed: no space left in #{Path.dirname(path)}; " <>
        "remove topics that nobody uses, or mount it with a larger size"

  def format_error({:system, path, operation, errno}),
    do: "#{path}: #{operation} failed: #{BB.Errno.message(errno)}"

  def format_error({:other_content, 0}),
    do: "the topic does not say what its messages are (it has no content tag)"

  def format_error({:other_content, tag}),
    do: "the topic has messages of another kind: its content tag is #{hex(tag)}"

  def format_error({:thread, text}), do: "no thread could be started: #{text}"
  def format_error(:closed), do: "it is closed"
  def format_error(:message_too_large), do: "the message is longer than a slot of the topic"
  def format_error(:slot_held), do: "subscribers hold all slots of the topic"
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

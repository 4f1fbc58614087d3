defmodule BB.Handoff.Outlet do
  @schema BB.Options.new!(
            from: [
              type: {:list, :atom},
              required: true,
              doc: "The pubsub path, with everything below it."
            ],
            topic: [
              type: {:custom, BB.Topic, :check_declared, []},
              required: true,
              doc: "The ring topic, after the robot's prefix (`BB.Topic`)."
            ],
            encoding: [
              type: {:behaviour, BB.Handoff.Encoding},
              required: true,
              doc: "How messages are encoded."
            ],
            slot_count: [
              type: {:custom, BB.Ring.Publisher, :check_slot_count, []},
              default: 16,
              doc: "As in `BB.Ring.Publisher`."
            ],
            slot_size: [
              type: {:in, 21..0x4000_0000},
              default: 4096,
              doc: "As in `BB.Ring.Publisher`."
            ]
          )

  @moduledoc """
  Carries a pubsub path into a ring topic.

      sensor :imu_outlet, {BB.Handoff.Outlet, from: [:sensor, :base_link, :imu], topic: "imu", encoding: BB.Handoff.Encoding.Imu}

  It subscribes to messages of the encoding's payload and publishes each on the topic, in the order in which they come. Native processes read the
  topic without knowing the robot.

  An encoding that does not return holds up its outlet alone: no more than some 4096 messages wait
  for it, and that it misses some is logged.

  `BB.Handoff.stats/2` gives `%{published: n, too_large: n, held: n}`. A message longer than a slot is counted, and the first one is logged. `held`
  counts the messages that were dropped since subscribers held all slots. When somebody removes the topic's file, it is made anew. That, and a
  process that holds a message for so long that the topic has to pass its slot over, is logged and told by `BB.Sensor.health/1`:
  `last_error` is `{:file_renewed, topic}` or `{:held, topic, os_pids}` and `error` has it in words, while the outlet goes on.

  `max_silence` is about what it carries: an outlet is `:stale` when it has published nothing on
  its topic for so long.

  When the ring refuses (`{:ring, reason}`, see `BB.Ring`), for example since another publisher lives, the outlet goes down and comes back by
  backoff as any sensor does.

  ## Options

  #{BB.Options.docs(@schema)}
  """

  use BB.Sensor, options_schema: @schema

  alias BB.Ring.Publisher

  @most_waiting 4_096

  # How often those who hold slots are looked for while messages are published, in milliseconds.
  @look_ms 1_000

  require Logger

  @impl BB.Sensor
  def init(opts) do
    %{robot: robot, path: path} = opts[:bb]
    encoding = opts[:encoding]

    subscription = [message_types: [encoding.payload()], max_queue: @most_waiting]

    with {:ok, _} <- BB.subscribe(robot, opts[:from], subscription),
         {:ok, topic} <- topic(robot, opts[:topic]),
         {:ok, publisher} <- open(topic, opts) do
      {:ok,
       %{
         publisher: publisher,
         encoding: encoding,
         path: path,
         published: 0,
         too_large: 0,
         held: 0,
         missed: 0,
         passed_over: 0,
         holders: [],
         looked_at: now_ms()
       }}
    else
      {:error, {:topic, _why} = reason} -> {:stop, reason}
      {:error, reason} -> {:stop, {:ring, reason}}
    end
  end

  defp topic(robot, name),
    do: with({:error, why} <- BB.Topic.of(robot, name), do: {:error, {:topic, why}})

  @doc false
  @impl BB.Sensor
  def topics(opts), do: List.wrap(opts[:topic])

  @impl BB.Sensor
  def handle_info({:bb, _path, message}, state) do
    state = look_for_holders(state, now_ms())

    case Publisher.publish(state.publisher, state.encoding.encode(message)) do
      :ok -> {:noreply, count_published(state)}
      {:error, :message_too_large} -> {:noreply, count_too_large(state)}
      {:error, :slot_held} -> {:noreply, %{state | held: state.held + 1}}
      {:error, reason} -> {:stop, {:shutdown, {:ring, reason}}, state}
    end
  end

  def handle_info({:bb_missed, _path, count}, state), do: {:noreply, count_missed(state, count)}

  def handle_info({:bb_ring_publisher, topic, :renewed}, state) do
    tell(state, {:file_renewed, topic})
    {:noreply, state}
  end

  def handle_info({:bb_ring_publisher, _topic, {:error, reason}}, state),
    do: {:stop, {:shutdown, {:ring, reason}}, state}

  def handle_info(_other, state), do: {:noreply, state}

  @impl BB.Sensor
  def handle_call(:stats, _from, state),
    do: {:reply, Map.take(state, [:published, :too_large, :held]), state}

  def handle_call(_request, _from, state), do: {:reply, {:error, :not_implemented}, state}

  @impl BB.Sensor
  def explain({:ring, reason}), do: BB.Ring.format_error(reason)
  def explain({:topic, why}), do: why

  def explain({:file_renewed, topic}),
    do: "somebody removed the file of the topic #{topic}; it was made anew"

  def explain({:held, topic, os_pids}) do
    "#{processes(os_pids)} held messages of the topic #{topic} for longer than its slots last, " <>
      "which costs others messages: look whether that hangs, or raise slot_count"
  end

  @impl BB.Sensor
  def terminate(_reason, state), do: Publisher.close(state.publisher)

  defp open(topic, opts) do
    Publisher.open(topic,
      slot_count: opts[:slot_count],
      slot_size: opts[:slot_size],
      content: opts[:encoding].content()
    )
  end

  defp processes([os_pid]), do: "process #{os_pid}"
  defp processes(os_pids), do: "processes #{Enum.join(os_pids, ", ")}"

  defp look_for_holders(%{looked_at: looked_at} = state, now_ms)
       when now_ms - looked_at < @look_ms,
       do: state

  defp look_for_holders(state, now_ms) do
    state = %{state | looked_at: now_ms}

    case Publisher.info(state.publisher) do
      {:ok, %{dropped_pinned: count} = info} when count > state.passed_over ->
        tell_of_holders(%{state | passed_over: count}, info)

      _nothing_new ->
        state
    end
  end

  # One that let go meanwhile is not known any more.
  defp tell_of_holders(state, info) do
    oldest = info.published - info.slot_count

    blocking =
      for reader <- info.readers, Enum.any?(reader.held, &(&1 < oldest)), do: reader.os_pid

    holders = blocking |> Enum.uniq() |> Enum.sort()
    # What still goes on was told.
    if holders not in [[], state.holders], do: tell(state, {:held, info.topic, holders})
    %{state | holders: holders}
  end

  defp tell(state, reason) do
    Logger.warning("#{List.last(state.path)}: #{explain(reason)}")
    BB.Sensor.trouble(reason)
  end

  defp now_ms, do: System.monotonic_time(:millisecond)

  defp count_published(state) do
    :ok = BB.Sensor.beat()
    %{state | published: state.published + 1}
  end

  defp count_missed(%{missed: missed} = state, count) do
    if missed == 0 do
      Logger.warning(
        "#{List.last(state.path)}: #{count} messages went by while it was busy with others; " <>
          "make its encoding quicker"
      )
    end

    %{state | missed: missed + count}
  end

  defp count_too_large(%{too_large: count} = state) do
    if count == 0 do
      Logger.warning(
        "#{List.last(state.path)}: a message is longer than the topic's slots and was dropped; raise slot_size"
      )
    end

    %{state | too_large: count + 1}
  end
end

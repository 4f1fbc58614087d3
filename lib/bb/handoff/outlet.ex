defmodule BB.Handoff.Outlet do
  @moduledoc """
  A sensor that carries a pubsub path into a ring topic.

  Declare one for each path that native programs read:

      sensor :imu_outlet,
             {BB.Handoff.Outlet,
              from: [:sensor, :base_link, :imu],
              topic: "imu",
              encoding: BB.Handoff.Encoding.Imu}

  The outlet subscribes to messages of the encoding's payload and publishes each of them on the
  topic, in their order. An encoding that does not return blocks its outlet alone: at most about
  4096 messages wait for the outlet, and the log says when it misses some.

  ## Counters

  `BB.Handoff.stats/2` returns `%{published: n, too_large: n, held: n}`. `too_large` counts
  messages that are longer than a slot; the first one is logged. `held` counts messages that were
  dropped because subscribers held all slots.

  ## Trouble

  An outlet runs on, logs, and shows an error in `BB.Sensor.health/1` in two cases:

    * `{:file_renewed, topic}` - the topic's file was removed, and the outlet has made it again
    * `{:held, topic, os_pids}` - the processes have held a message for so long that the topic
      skips its slot

  When the ring refuses to publish (`{:ring, reason}`, see `BB.Ring`), for example because another
  publisher lives, the outlet goes down and is restarted by backoff, as any sensor is.

  ## Silence

  `max_silence` measures the messages that the outlet publishes on its topic: the outlet is
  `:stale` when it has published none for that time.

  ## Options

  #{BB.Options.docs(BB.Handoff.Outlet.Options.schema())}
  """

  use BB.Sensor, options_schema: BB.Handoff.Outlet.Options.schema()

  alias BB.Ring.Publisher

  @max_queue 4_096

  # The period of the check for held slots, while messages are published.
  @check_ms 1_000

  require Logger

  @impl BB.Sensor
  def init(opts) do
    %{robot: robot, path: path} = opts[:bb]
    encoding = opts[:encoding]

    subscription = [message_types: [encoding.payload()], max_queue: @max_queue]

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
         checked_ms: now_ms()
       }}
    else
      {:error, {:topic, _message} = reason} -> {:stop, reason}
      {:error, reason} -> {:stop, {:ring, reason}}
    end
  end

  defp topic(robot, name),
    do: with({:error, message} <- BB.Topic.of(robot, name), do: {:error, {:topic, message}})

  @doc false
  @impl BB.Sensor
  def topics(opts), do: List.wrap(opts[:topic])

  @impl BB.Sensor
  def handle_info({:bb, _path, message}, state) do
    state = check_holders(state, now_ms())

    case Publisher.publish(state.publisher, state.encoding.encode(message)) do
      :ok -> {:noreply, count_published(state)}
      {:error, :message_too_large} -> {:noreply, count_too_large(state)}
      {:error, :slot_held} -> {:noreply, %{state | held: state.held + 1}}
      {:error, reason} -> {:stop, {:shutdown, {:ring, reason}}, state}
    end
  end

  def handle_info({:bb_missed, _path, count}, state), do: {:noreply, count_missed(state, count)}

  def handle_info({:bb_ring_publisher, topic, :renewed}, state) do
    report_trouble(state, {:file_renewed, topic})
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
  def explain({:topic, message}), do: message

  def explain({:file_renewed, topic}),
    do: "the file of the topic #{topic} was removed, and has been made again"

  def explain({:held, topic, os_pids}) do
    "#{processes(os_pids)} held messages of the topic #{topic} for longer than its slots " <>
      "last, and other subscribers lose messages: check whether it hangs, or raise slot_count"
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

  defp check_holders(%{checked_ms: checked_ms} = state, now_ms)
       when now_ms - checked_ms < @check_ms,
       do: state

  defp check_holders(state, now_ms) do
    state = %{state | checked_ms: now_ms}

    case Publisher.info(state.publisher) do
      {:ok, %{dropped_pinned: count} = info} when count > state.passed_over ->
        report_holders(%{state | passed_over: count}, info)

      _unchanged ->
        state
    end
  end

  # A process that has released its message meanwhile is not found.
  defp report_holders(state, info) do
    oldest = info.published - info.slot_count

    blocking =
      for reader <- info.readers, Enum.any?(reader.held, &(&1 < oldest)), do: reader.os_pid

    holders = blocking |> Enum.uniq() |> Enum.sort()
    # Holders that have not changed were reported before.
    if holders not in [[], state.holders],
      do: report_trouble(state, {:held, info.topic, holders})

    %{state | holders: holders}
  end

  defp report_trouble(state, reason) do
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
        "#{List.last(state.path)}: #{count} messages were missed while earlier ones were " <>
          "encoded; make the encoding faster"
      )
    end

    %{state | missed: missed + count}
  end

  defp count_too_large(%{too_large: count} = state) do
    if count == 0 do
      Logger.warning(
        "#{List.last(state.path)}: a message longer than the topic's slots was dropped; " <>
          "raise slot_size"
      )
    end

    %{state | too_large: count + 1}
  end
end

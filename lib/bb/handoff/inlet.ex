defmodule BB.Handoff.Inlet do
  @schema BB.Options.new!(
            topic: [
              type: {:custom, BB.Topic, :check_declared_found, []},
              required: true,
              doc: "The ring topic, after the robot's prefix (`BB.Topic`)."
            ],
            encoding: [
              type: {:behaviour, BB.Handoff.Encoding},
              required: true,
              doc: "How messages are encoded."
            ],
            to: [
              type: {:list, :atom},
              doc: "The pubsub path; without it the sensor's own, `[:sensor | path]`."
            ],
            credits: [
              type: {:in, 1..1024},
              default: 64,
              doc:
                "Messages that may wait in the inlet's mailbox; what comes faster stays in the ring and may be lost there."
            ],
            untagged: [
              type: :boolean,
              default: false,
              doc:
                "Whether to take a topic whose publisher does not say what its messages are. " <>
                  "What does not decode is malformed then, what decodes by chance is published."
            ]
          )

  @moduledoc """
  Carries a ring topic onto a pubsub path.

      sensor :tags_inlet, {BB.Handoff.Inlet, topic: "tags", encoding: BB.Handoff.Encoding.TagDetections, to: [:sensor, :base_link, :tags]}

  The topic need not exist yet; it may come, go and come back.

  A topic says what its messages are, by the name of an encoding that its publisher gives
  (`content`). When that is another one than the inlet's, also later when another publisher has
  come, the inlet publishes nothing: it goes down with `{:other_content, name}` (the tag where the
  name is not known, `:untagged` where the topic names none), and comes back by backoff when the
  topic is what it expects.

  `BB.Handoff.stats/2` gives `%{published: n, lost: n, malformed: n}`: `lost` counts what the ring overwrote before it was read; a message
  that does not decode is counted as malformed, and the first of a row is logged.

  `max_silence` is about what it carries, wherever `to:` leads: an inlet is `:stale` when it has
  published nothing for so long.

  ## Options

  #{BB.Options.docs(@schema)}
  """

  use BB.Sensor, options_schema: @schema

  alias BB.Handoff.Content
  alias BB.Ring.{Message, Subscriber}

  require Logger

  @counters [:published, :lost, :malformed]

  @impl BB.Sensor
  def init(opts) do
    %{robot: robot, path: path} = opts[:bb]

    with {:ok, topic} <- topic(robot, opts[:topic]),
         {:ok, ring} <- Subscriber.open(topic, subscription(opts)) do
      {:ok,
       %{
         robot: robot,
         name: List.last(path),
         ring: ring,
         ref: ring.ref,
         encoding: opts[:encoding],
         to: opts[:to] || [:sensor | path],
         credits: opts[:credits],
         used: 0,
         decodes?: true,
         published: 0,
         lost: 0,
         malformed: 0
       }}
    else
      {:error, reason} -> {:stop, down(reason)}
    end
  end

  defp topic(robot, name),
    do: with({:error, why} <- BB.Topic.of(robot, name), do: {:error, {:topic, why}})

  @doc false
  @impl BB.Sensor
  def topics(opts), do: List.wrap(opts[:topic])

  defp subscription(opts) do
    [active: opts[:credits], content: opts[:encoding].content(), untagged: opts[:untagged]]
  end

  defp down({:other_content, tag}), do: {:other_content, Content.name(tag)}
  defp down({:topic, _why} = reason), do: reason
  defp down(reason), do: {:ring, reason}

  @impl BB.Sensor
  def handle_info({:bb_ring, ref, %Message{} = message}, %{ref: ref} = state) do
    {:noreply,
     %{state | lost: state.lost + message.lost} |> publish(message.data) |> use_credit()}
  end

  def handle_info({:bb_ring, ref, {:error, {:other_content, _} = reason}}, %{ref: ref} = state),
    do: {:stop, {:shutdown, down(reason)}, state}

  def handle_info({:bb_ring, ref, {:error, reason}}, %{ref: ref} = state) do
    Logger.warning("#{state.name}: #{BB.Ring.format_error(reason)}")
    {:noreply, state}
  end

  def handle_info({:bb_ring_passive, ref}, %{ref: ref} = state), do: {:noreply, give_back(state)}
  def handle_info(_other, state), do: {:noreply, state}

  @impl BB.Sensor
  def handle_call(:stats, _from, state), do: {:reply, Map.take(state, @counters), state}
  def handle_call(_request, _from, state), do: {:reply, {:error, :not_implemented}, state}

  @impl BB.Sensor
  def explain({:ring, reason}), do: BB.Ring.format_error(reason)
  def explain({:topic, why}), do: why
  def explain({:other_content, content}), do: Content.explain(content)

  @impl BB.Sensor
  def terminate(_reason, state), do: Subscriber.close(state.ring)

  defp publish(state, data) do
    case state.encoding.decode(data) do
      {:ok, message} ->
        :ok = BB.publish(state.robot, state.to, message)
        :ok = BB.Sensor.beat()
        %{state | published: state.published + 1, decodes?: true}

      {:error, reason} ->
        if state.decodes?,
          do:
            Logger.warning(
              "#{state.name}: a message on the ring does not decode: #{inspect(reason)}"
            )

        %{state | malformed: state.malformed + 1, decodes?: false}
    end
  end

  # Credits are given back by halves, so that the ring's thread is seldom disturbed and never left without.
  defp use_credit(state) do
    state = %{state | used: state.used + 1}
    if 2 * state.used >= state.credits, do: give_back(state), else: state
  end

  defp give_back(state) do
    _ = Subscriber.active(state.ring, state.used)
    %{state | used: 0}
  end
end

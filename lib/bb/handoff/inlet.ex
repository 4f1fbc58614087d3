defmodule BB.Handoff.Inlet do
  @moduledoc """
  A sensor that carries a ring topic onto a pubsub path.

  Declare one for each topic of a native program that the robot's Elixir code reads:

      sensor :tags_inlet,
             {BB.Handoff.Inlet,
              topic: "tags",
              encoding: BB.Handoff.Encoding.TagDetections,
              to: [:sensor, :base_link, :tags]}

  The topic need not exist yet, and may disappear and appear again.

  ## Content

  A topic carries the name of its encoding, which its publisher sets (`content`), as a content
  tag. When that is another encoding than the inlet's, also later with another publisher, the
  inlet publishes nothing. It goes down with `{:other_content, name}`, and is up again when the
  topic has the expected content. `name` is the tag when its name is not known, and `:untagged`
  when the topic has none.

  ## Counters

  `BB.Handoff.stats/2` returns `%{published: n, lost: n, malformed: n}`. `lost` counts messages
  that the ring overwrote before they were read, `malformed` messages that do not decode. The
  first malformed message in a row is logged.

  ## Silence

  `max_silence` measures the messages that the inlet publishes, on whichever path: the inlet is
  `:stale` when it has published none for that time.

  ## Options

  #{BB.Options.docs(BB.Handoff.Inlet.Options.schema())}
  """

  use BB.Sensor, options_schema: BB.Handoff.Inlet.Options.schema()

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
      {:error, reason} -> {:stop, stop_reason(reason)}
    end
  end

  defp topic(robot, name),
    do: with({:error, message} <- BB.Topic.of(robot, name), do: {:error, {:topic, message}})

  @doc false
  @impl BB.Sensor
  def topics(opts), do: List.wrap(opts[:topic])

  defp subscription(opts) do
    [active: opts[:credits], content: opts[:encoding].content(), untagged: opts[:untagged]]
  end

  defp stop_reason({:other_content, tag}), do: {:other_content, Content.name(tag)}
  defp stop_reason({:topic, _message} = reason), do: reason
  defp stop_reason(reason), do: {:ring, reason}

  @impl BB.Sensor
  def handle_info({:bb_ring, ref, %Message{} = message}, %{ref: ref} = state) do
    {:noreply,
     %{state | lost: state.lost + message.lost} |> publish(message.data) |> use_credit()}
  end

  def handle_info({:bb_ring, ref, {:error, {:other_content, _} = reason}}, %{ref: ref} = state),
    do: {:stop, {:shutdown, stop_reason(reason)}, state}

  def handle_info({:bb_ring, ref, {:error, reason}}, %{ref: ref} = state) do
    Logger.warning("#{state.name}: #{BB.Ring.format_error(reason)}")
    {:noreply, state}
  end

  def handle_info({:bb_ring_passive, ref}, %{ref: ref} = state),
    do: {:noreply, return_credits(state)}

  def handle_info(_other, state), do: {:noreply, state}

  @impl BB.Sensor
  def handle_call(:stats, _from, state), do: {:reply, Map.take(state, @counters), state}
  def handle_call(_request, _from, state), do: {:reply, {:error, :not_implemented}, state}

  @impl BB.Sensor
  def explain({:ring, reason}), do: BB.Ring.format_error(reason)
  def explain({:topic, message}), do: message
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
        if state.decodes?, do: log_malformed(state, reason)
        %{state | malformed: state.malformed + 1, decodes?: false}
    end
  end

  defp log_malformed(state, reason),
    do: Logger.warning("#{state.name}: a message on the ring does not decode: #{inspect(reason)}")

  # Credits are returned by halves, so that the ring's thread is seldom woken and always has some.
  defp use_credit(state) do
    state = %{state | used: state.used + 1}
    if 2 * state.used >= state.credits, do: return_credits(state), else: state
  end

  defp return_credits(state) do
    _ = Subscriber.active(state.ring, state.used)
    %{state | used: 0}
  end
end

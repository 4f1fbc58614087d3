defmodule BB.PubSub.Streams do
  @moduledoc """
  The streams of a pubsub: each path with each payload type that was published there, and its
  meter.

  A publisher without a route finds the meter of its stream here, and so do `BB.PubSub.topics/1`
  and the components that check for silence:

      {class, meter} = Streams.fetch(bus, [:sensor, :base_link, :imu], BB.Message.Sensor.Imu)

  The meters of permanent paths are rows `{{path, type}, meter}` of the table `streams`, the
  others of `transient` (`BB.PubSub.TransientPaths`).
  """

  alias BB.Path
  alias BB.PubSub.{Bus, Meter, TransientPaths}

  @typedoc "Whether the path of a stream is permanent or transient."
  @type class :: :permanent | :transient

  @typedoc "A stream with its meter."
  @type metered :: {{Path.t(), module()}, Meter.t()}

  @typedoc "What `BB.PubSub.topics/1` reports of a stream."
  @type topic :: %{
          path: Path.t(),
          type: module(),
          count: non_neg_integer(),
          rate_hz: float(),
          age_ns: integer()
        }

  @doc """
  Returns the class and the meter of a stream, a new meter for a new stream.

  A new permanent stream is reported to the registrar, which makes a route for it.
  """
  @spec fetch(Bus.t(), Path.t(), module()) :: {class(), Meter.t()}
  def fetch(bus, path, type) do
    key = {path, type}

    case {:ets.lookup(bus.streams, key), :ets.lookup(bus.transient, key)} do
      {[{_, meter}], _} -> {:permanent, meter}
      {[], [{_, meter}]} -> {:transient, meter}
      {[], []} -> insert(bus, key)
    end
  end

  defp insert(bus, {path, _type} = key) do
    if TransientPaths.permanent?(bus, path),
      do: {:permanent, insert_permanent(bus, key)},
      else: {:transient, insert_transient(bus, key)}
  end

  defp insert_permanent(bus, {path, type} = key) do
    meter = Meter.new()

    if :ets.insert_new(bus.streams, {key, meter}) do
      GenServer.cast(bus.registrar, {:new_stream, path, type})
      meter
    else
      :ets.lookup_element(bus.streams, key, 2)
    end
  end

  defp insert_transient(bus, {path, _type} = key) do
    meter = Meter.new()
    :ok = TransientPaths.remember(bus, path)
    inserted? = :ets.insert_new(bus.transient, {key, meter})
    if inserted? and not TransientPaths.member?(bus, path), do: :ets.delete(bus.transient, key)
    if inserted?, do: meter, else: lookup(bus, key, meter)
  end

  # The path may have been forgotten since.
  defp lookup(bus, key, default) do
    case :ets.lookup(bus.transient, key) do
      [{_, meter}] -> meter
      [] -> default
    end
  end

  @doc "Returns the meters of the streams at exactly this path, one for each payload type."
  @spec meters(Bus.t(), Path.t()) :: [Meter.t()]
  def meters(bus, path) do
    for table <- [bus.streams, bus.transient],
        {{^path, type}, meter} <- :ets.select(table, [{{{path, :_}, :_}, [], [:"$_"]}]),
        is_atom(type),
        do: meter
  end

  @doc "Returns the permanent streams."
  @spec permanent(Bus.t()) :: [metered()]
  def permanent(bus), do: :ets.tab2list(bus.streams)

  defp transient(bus) do
    for {{path, type}, meter} <- :ets.tab2list(bus.transient), is_list(path), is_atom(type) do
      {{path, type}, meter}
    end
  end

  @doc "Returns a report of each stream, sorted by path. `now_ns` is the monotonic time now."
  @spec topics(Bus.t(), integer()) :: [topic()]
  def topics(bus, now_ns) do
    for {{path, type}, meter} <- Enum.sort(permanent(bus) ++ transient(bus)),
        (count = Meter.counted(meter)) > 0,
        do: topic(path, type, count, Meter.times(meter, count), now_ns)
  end

  defp topic(path, type, count, [newest | _] = times, now_ns) do
    %{
      path: path,
      type: type,
      count: count,
      rate_hz: Meter.rate_hz(times, now_ns),
      age_ns: now_ns - newest
    }
  end
end

defmodule Ganglion.Demo.Observation do
  @moduledoc """
  What the demonstration has seen so far: messages by path, detections with their latency, the ring's topics. Pure; times are Erlang
  monotonic nanoseconds.
  """

  alias BB.Message
  alias BB.Message.Sensor.Status
  alias BB.Message.Vision.TagDetections
  alias Ganglion.Demo.Latency

  defstruct paths: %{}, frames: 0, detections: 0, latency: Latency.new(), topics: %{}, lost: %{}

  @typedoc "Something that counts up: how far, since when, and how far it was a look ago."
  @type counter :: %{
          count: non_neg_integer(),
          first: {non_neg_integer(), integer()},
          last: {non_neg_integer(), integer()},
          look: {non_neg_integer(), integer()}
        }

  @type t :: %__MODULE__{
          paths: %{BB.Path.t() => {counter(), struct()}},
          frames: non_neg_integer(),
          detections: non_neg_integer(),
          latency: Latency.t(),
          topics: %{String.t() => {counter(), BB.Ring.info()}},
          lost: %{term() => non_neg_integer()}
        }

  @doc "Counts a message of the pubsub."
  @spec message(t(), BB.Path.t(), Message.t(), integer()) :: t()
  def message(observation, _path, %Message{payload: %Status{}}, _now), do: observation

  def message(observation, path, %Message{payload: payload}, now) do
    observation |> count_path(path, payload, now) |> count_vision(payload, now)
  end

  @doc "Notes a topic as it stands."
  @spec topic(t(), BB.Ring.info(), integer()) :: t()
  def topic(observation, info, now) do
    counter =
      case Map.fetch(observation.topics, info.topic) do
        {:ok, {counter, _}} when info.published >= counter.count ->
          advance(counter, info.published, now)

        # A topic that was made anew counts from the start again.
        _ ->
          start(info.published, now)
      end

    lost =
      for reader <- info.readers,
          into: observation.lost,
          do: {{info.topic, reader.os_pid, reader.index}, reader.lost}

    %{observation | topics: Map.put(observation.topics, info.topic, {counter, info}), lost: lost}
  end

  @doc "Remembers how far everything is, for `rate/1` at the next look."
  @spec looked(t()) :: t()
  def looked(observation) do
    %{observation | paths: looked_at(observation.paths), topics: looked_at(observation.topics)}
  end

  @doc "How many were counted."
  @spec count(counter()) :: non_neg_integer()
  def count(%{count: count, first: {before, _}}), do: count - before

  @doc "Per second, since the last look."
  @spec rate(counter()) :: float()
  def rate(%{look: look, last: last}), do: per_second(look, last)

  @doc "Per second, from the first to the last."
  @spec mean_rate(counter()) :: float()
  def mean_rate(%{first: first, last: last}), do: per_second(first, last)

  @doc "Nanoseconds since the last one."
  @spec age(counter(), integer()) :: integer()
  def age(%{last: {_, time}}, now), do: now - time

  @doc "Messages of any topic that any of its readers lost."
  @spec lost(t()) :: non_neg_integer()
  def lost(observation), do: observation.lost |> Map.values() |> Enum.sum()

  defp count_path(observation, path, payload, now) do
    counter =
      case observation.paths do
        %{^path => {counter, _}} -> advance(counter, counter.count + 1, now)
        # The first message is counted, and the clock of the rate starts with it.
        _ -> %{start(1, now) | first: {0, now}, look: {1, now}}
      end

    %{observation | paths: Map.put(observation.paths, path, {counter, payload})}
  end

  defp count_vision(observation, %TagDetections{} = found, now) do
    %{
      observation
      | frames: observation.frames + 1,
        detections: observation.detections + length(found.detections),
        latency: Latency.add(observation.latency, now - found.capture_time)
    }
  end

  defp count_vision(observation, _payload, _now), do: observation

  defp start(count, now),
    do: %{count: count, first: {count, now}, last: {count, now}, look: {count, now}}

  defp advance(counter, count, now), do: %{counter | count: count, last: {count, now}}

  defp looked_at(counters),
    do:
      Map.new(counters, fn {key, {counter, value}} ->
        {key, {%{counter | look: counter.last}, value}}
      end)

  defp per_second({from, start}, {to, finish}) when finish > start,
    do: (to - from) * 1.0e9 / (finish - start)

  defp per_second(_from, _to), do: 0.0
end

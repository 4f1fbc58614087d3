defmodule Ganglion.Demo.Observation do
  @moduledoc """
  The messages, detections and ring topics that the demonstration has observed so far.

  `Ganglion.Demo` updates it with each message and once a second with each ring topic, and
  `Ganglion.Demo.Report` shows it. It is pure; times are Erlang monotonic nanoseconds.

      observation = Ganglion.Demo.Observation.new([], now)
      observation = Ganglion.Demo.Observation.message(observation, path, message, now)
  """

  alias BB.Message
  alias BB.Message.Vision.TagDetections
  alias Ganglion.Demo.{Counter, Latency}

  defstruct paths: %{}, frames: 0, detections: 0, latency: Latency.new(), topics: %{}, lost: %{}

  @typedoc """
  Counters by path and by topic, each with the last payload or topic information. `frames` and
  `detections` count camera frames and tags; `lost` counts the lost messages of each reader.
  """
  @type t :: %__MODULE__{
          paths: %{BB.Path.t() => {Counter.t(), payload :: struct()}},
          frames: non_neg_integer(),
          detections: non_neg_integer(),
          latency: Latency.t(),
          topics: %{String.t() => {Counter.t(), BB.Ring.info()}},
          lost: %{(reader :: term()) => non_neg_integer()}
        }

  @doc "Returns an observation that starts now. Earlier messages of these topics do not count."
  @spec new([BB.Ring.info()], integer()) :: t()
  def new(infos, now) do
    %__MODULE__{topics: Map.new(infos, &{&1.topic, {Counter.start(&1.published, now), &1}})}
  end

  @doc "Counts a message from the pubsub."
  @spec message(t(), BB.Path.t(), Message.t(), integer()) :: t()
  def message(observation, path, %Message{payload: payload}, now) do
    {counter, _payload} = Map.get(observation.paths, path, {nil, nil})

    %{observation | paths: Map.put(observation.paths, path, {Counter.hit(counter, now), payload})}
    |> count_vision(payload, now)
  end

  @doc "Updates a topic with its current information."
  @spec topic(t(), BB.Ring.info(), integer()) :: t()
  def topic(observation, info, now) do
    {counter, _info} = Map.get(observation.topics, info.topic, {nil, nil})
    entry = {Counter.reach(counter, info.published, now), info}

    %{
      observation
      | topics: Map.put(observation.topics, info.topic, entry),
        lost: Map.merge(observation.lost, losses(info))
    }
  end

  @doc "Starts a new interval for the rates."
  @spec look(t()) :: t()
  def look(observation) do
    %{observation | paths: look_at(observation.paths), topics: look_at(observation.topics)}
  end

  @doc "Returns how many messages all readers of all topics have lost."
  @spec lost(t()) :: non_neg_integer()
  def lost(observation), do: observation.lost |> Map.values() |> Enum.sum()

  # A reader that is started again counts from 0, in another process.
  defp losses(info) do
    Map.new(info.readers, &{{info.topic, &1.os_pid, &1.index}, &1.lost})
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

  defp look_at(counted) do
    Map.new(counted, fn {key, {counter, value}} -> {key, {Counter.look(counter), value}} end)
  end
end

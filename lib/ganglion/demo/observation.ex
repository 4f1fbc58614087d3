defmodule Ganglion.Demo.Observation do
  @moduledoc """
  What the demonstration has seen so far: messages by path, detections with their latency, the ring's topics. Pure; times are Erlang
  monotonic nanoseconds.
  """

  alias BB.Message
  alias BB.Message.Vision.TagDetections
  alias Ganglion.Demo.{Counter, Latency}

  defstruct paths: %{}, frames: 0, detections: 0, latency: Latency.new(), topics: %{}, lost: %{}

  @type t :: %__MODULE__{
          paths: %{BB.Path.t() => {Counter.t(), payload :: struct()}},
          frames: non_neg_integer(),
          detections: non_neg_integer(),
          latency: Latency.t(),
          topics: %{String.t() => {Counter.t(), BB.Ring.info()}},
          lost: %{(reader :: term()) => non_neg_integer()}
        }

  @doc "A start from these topics: what they have published already does not count."
  @spec new([BB.Ring.info()], integer()) :: t()
  def new(infos, now) do
    %__MODULE__{topics: Map.new(infos, &{&1.topic, {Counter.start(&1.published, now), &1}})}
  end

  @doc "Counts a message of the pubsub."
  @spec message(t(), BB.Path.t(), Message.t(), integer()) :: t()
  def message(observation, path, %Message{payload: payload}, now) do
    {counter, _payload} = Map.get(observation.paths, path, {nil, nil})

    %{observation | paths: Map.put(observation.paths, path, {Counter.hit(counter, now), payload})}
    |> count_vision(payload, now)
  end

  @doc "Notes a topic as it stands."
  @spec topic(t(), BB.Ring.info(), integer()) :: t()
  def topic(observation, info, now) do
    {counter, _info} = Map.get(observation.topics, info.topic, {nil, nil})
    noted = {Counter.reach(counter, info.published, now), info}

    %{
      observation
      | topics: Map.put(observation.topics, info.topic, noted),
        lost: Map.merge(observation.lost, losses(info))
    }
  end

  @doc "Takes a look: rates count from here."
  @spec looked(t()) :: t()
  def looked(observation) do
    %{observation | paths: looked_at(observation.paths), topics: looked_at(observation.topics)}
  end

  @doc "Messages of any topic that any of its readers lost."
  @spec lost(t()) :: non_neg_integer()
  def lost(observation), do: observation.lost |> Map.values() |> Enum.sum()

  # A reader that was killed and came back counts from 0, in another process.
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

  defp looked_at(counted) do
    Map.new(counted, fn {key, {counter, value}} -> {key, {Counter.look(counter), value}} end)
  end
end

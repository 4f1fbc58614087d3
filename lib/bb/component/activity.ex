defmodule BB.Component.Activity do
  @moduledoc """
  When a component was last heard of: by a message on its path, or by its own heartbeat.

  The keeper reads this when a silence would be too long, from what publishers count anyway
  (`BB.PubSub.Meter`). No message comes to the keeper, and none costs more for being watched.
  """

  alias BB.Component.Heartbeat
  alias BB.PubSub.{Bus, Meter, Streams}

  @enforce_keys [:robot, :path, :heartbeat, :looked_ns, :heard_ns]
  defstruct [:robot, :path, :heartbeat, :looked_ns, :heard_ns, meters: [], count: 0]

  @type t :: %__MODULE__{
          robot: module(),
          path: [atom(), ...],
          heartbeat: Heartbeat.t(),
          looked_ns: integer(),
          heard_ns: integer(),
          meters: [Meter.t()],
          count: non_neg_integer()
        }

  @doc "Begins to listen: what was published before does not count."
  @spec new(module(), [atom(), ...], Heartbeat.t(), integer()) :: t()
  def new(robot, path, heartbeat, now_ns) do
    meters = find_meters(robot, path)

    %__MODULE__{
      robot: robot,
      path: path,
      heartbeat: heartbeat,
      looked_ns: now_ns,
      heard_ns: now_ns,
      meters: meters,
      count: count(meters)
    }
  end

  @doc "Looks what has been heard by now."
  @spec look(t(), integer()) :: t()
  def look(activity, now_ns) do
    looked = activity |> hear_messages(now_ns) |> hear_pulse()
    looked = if looked.heard_ns == activity.heard_ns, do: look_anew(looked, now_ns), else: looked
    %{looked | looked_ns: now_ns}
  end

  # A payload of another type has a meter of its own.
  defp look_anew(activity, now_ns),
    do: hear_messages(%{activity | meters: find_meters(activity.robot, activity.path)}, now_ns)

  defp hear_messages(activity, now_ns) do
    case count(activity.meters) do
      count when count == activity.count ->
        activity

      count ->
        stamp_ns = activity.meters |> Enum.map(&Meter.newest/1) |> Enum.max(fn -> now_ns end)
        heard(%{activity | count: count}, published_ns(activity, stamp_ns, now_ns))
    end
  end

  # A message may be stamped with any time. It was published since the last look, that is certain.
  defp published_ns(%{looked_ns: looked_ns}, stamp_ns, now_ns),
    do: if(stamp_ns > looked_ns and stamp_ns <= now_ns, do: stamp_ns, else: now_ns)

  defp hear_pulse(activity),
    do: heard(activity, Heartbeat.heard_ns(activity.heartbeat) || activity.heard_ns)

  defp heard(activity, time_ns), do: %{activity | heard_ns: max(activity.heard_ns, time_ns)}

  defp count(meters), do: meters |> Enum.map(&Meter.counted/1) |> Enum.sum()

  defp find_meters(robot, path) do
    case Bus.fetch(robot) do
      {:ok, bus} -> Streams.meters(bus, path)
      :error -> []
    end
  rescue
    # The bus is being closed.
    ArgumentError -> []
  end
end

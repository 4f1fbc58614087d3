defmodule BB.Component.Activity do
  @moduledoc """
  The time of a component's last activity: a message on its path, or a heartbeat.

  `BB.Component.Keeper` reads it to find a component that is silent. It reads what publishers
  count anyway (`BB.PubSub.Meter`), so that no message is sent to the keeper and none costs more
  because its component is watched.
  """
  @moduledoc no_example: "internal: `max_silence` in a robot's declaration turns it on"

  alias BB.Component.Heartbeat
  alias BB.PubSub.{Bus, Meter, Streams}

  @enforce_keys [:robot, :path, :heartbeat, :checked_ns, :last_ns]
  defstruct [:robot, :path, :heartbeat, :checked_ns, :last_ns, meters: [], count: 0]

  @type t :: %__MODULE__{
          robot: module(),
          path: [atom(), ...],
          heartbeat: Heartbeat.t(),
          checked_ns: integer(),
          last_ns: integer(),
          meters: [Meter.t()],
          count: non_neg_integer()
        }

  @doc "Returns an activity that begins now. Messages that were published before do not count."
  @spec new(module(), [atom(), ...], Heartbeat.t(), integer()) :: t()
  def new(robot, path, heartbeat, now_ns) do
    meters = find_meters(robot, path)

    %__MODULE__{
      robot: robot,
      path: path,
      heartbeat: heartbeat,
      checked_ns: now_ns,
      last_ns: now_ns,
      meters: meters,
      count: count(meters)
    }
  end

  @doc "Updates the time of the last activity."
  @spec update(t(), integer()) :: t()
  def update(activity, now_ns) do
    updated = activity |> count_messages(now_ns) |> read_heartbeat()

    updated =
      if updated.last_ns == activity.last_ns, do: find_messages(updated, now_ns), else: updated

    %{updated | checked_ns: now_ns}
  end

  # A payload of a type that is new on the path has a meter of its own.
  defp find_messages(activity, now_ns),
    do: count_messages(%{activity | meters: find_meters(activity.robot, activity.path)}, now_ns)

  defp count_messages(activity, now_ns) do
    case count(activity.meters) do
      count when count == activity.count ->
        activity

      count ->
        stamp_ns = activity.meters |> Enum.map(&Meter.newest/1) |> Enum.max(fn -> now_ns end)
        put_last(%{activity | count: count}, published_ns(activity, stamp_ns, now_ns))
    end
  end

  # A message may carry any time. The count says that it was published since the last check.
  defp published_ns(%{checked_ns: checked_ns}, stamp_ns, now_ns),
    do: if(stamp_ns > checked_ns and stamp_ns <= now_ns, do: stamp_ns, else: now_ns)

  defp read_heartbeat(activity),
    do: put_last(activity, Heartbeat.last_ns(activity.heartbeat) || activity.last_ns)

  defp put_last(activity, time_ns), do: %{activity | last_ns: max(activity.last_ns, time_ns)}

  defp count(meters), do: meters |> Enum.map(&Meter.counted/1) |> Enum.sum()

  defp find_meters(robot, path) do
    case Bus.fetch(robot) do
      {:ok, bus} -> Streams.meters(bus, path)
      :error -> []
    end
  rescue
    # The pubsub is being closed.
    ArgumentError -> []
  end
end

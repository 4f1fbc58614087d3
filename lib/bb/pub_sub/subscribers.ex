defmodule BB.PubSub.Subscribers do
  @moduledoc """
  The subscribers of a pubsub: a monitor for each, the number of subscriptions at each path, and
  the processes with a `unique` subscription.

  `BB.PubSub.Registrar` holds it in its state. The calling process owns the monitors:

      subscribers = Subscribers.track(Subscribers.new(), subscription)
      Subscribers.count_reached(subscribers, [:sensor, :base_link, :imu])
      #=> 1
  """

  alias BB.Path
  alias BB.PubSub.Subscription

  defstruct monitors: %{}, sizes: %{}, unique: %{}

  @type t :: %__MODULE__{
          monitors: %{pid() => reference()},
          sizes: %{Path.t() => pos_integer()},
          unique: %{pid() => true}
        }

  @doc "Returns the state without any subscriber."
  @spec new() :: t()
  def new, do: %__MODULE__{}

  @doc "Adds a subscription, and monitors its process if it is the first of that."
  @spec track(t(), Subscription.t()) :: t()
  def track(subscribers, %{pid: pid, path: path, unique: unique}) do
    subscribers = subscribers |> resize(path, 1) |> monitor(pid)
    if unique, do: put_in(subscribers.unique[pid], true), else: subscribers
  end

  defp monitor(%{monitors: monitors} = subscribers, pid) when is_map_key(monitors, pid),
    do: subscribers

  defp monitor(subscribers, pid), do: put_in(subscribers.monitors[pid], Process.monitor(pid))

  @doc "Removes the subscriptions `removed` of a process at a path, given those that it has left."
  @spec untrack(t(), pid(), Path.t(), [Subscription.t()], [Subscription.t()]) :: t()
  def untrack(subscribers, pid, path, removed, left) do
    subscribers = resize(subscribers, path, -length(removed))

    if Enum.any?(left, & &1.unique),
      do: subscribers,
      else: %{subscribers | unique: Map.delete(subscribers.unique, pid)}
  end

  @doc "Ends the monitor of a process that has no subscription left."
  @spec demonitor(t(), pid()) :: t()
  def demonitor(subscribers, pid) do
    {ref, monitors} = Map.pop(subscribers.monitors, pid)
    if ref, do: Process.demonitor(ref, [:flush])
    %{subscribers | monitors: monitors}
  end

  @doc "Removes the monitor of a process that has ended."
  @spec delete_monitor(t(), pid()) :: t()
  def delete_monitor(subscribers, pid),
    do: %{subscribers | monitors: Map.delete(subscribers.monitors, pid)}

  @doc "Returns whether the process has a `unique` subscription."
  @spec unique?(t(), pid()) :: boolean()
  def unique?(subscribers, pid), do: is_map_key(subscribers.unique, pid)

  @doc "Returns how many subscriptions a message published at the path reaches."
  @spec count_reached(t(), Path.t()) :: non_neg_integer()
  def count_reached(%{sizes: sizes}, path) do
    Enum.reduce(Path.ancestors(path), Map.get(sizes, path, 0), &(Map.get(sizes, &1, 0) + &2))
  end

  defp resize(subscribers, path, change) do
    case Map.get(subscribers.sizes, path, 0) + change do
      0 -> %{subscribers | sizes: Map.delete(subscribers.sizes, path)}
      size -> %{subscribers | sizes: Map.put(subscribers.sizes, path, size)}
    end
  end
end

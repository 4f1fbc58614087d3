defmodule BB.PubSub.TransientPaths do
  @most_permanent 4_000
  @most_transient 1_000

  @moduledoc """
  Remembers the newest transient paths, and forgets the oldest with everything that is kept for
  them.

  A path is *permanent* when it consists of atoms and belongs to one of the first
  #{@most_permanent} streams of its robot: its meters, cells and last message are kept as long as
  the robot runs. Any other path is *transient*: it contains a reference, or comes after those.
  The newest #{@most_transient} transient paths are remembered, and beside them the newest
  #{@most_transient} of those on which messages are retained. When a path is forgotten, its
  meters, cells and last message are deleted; if it is published again, it starts anew.

  `BB.PubSub.Streams` remembers a path on its first message:

      if TransientPaths.permanent?(bus, path), do: :ok, else: TransientPaths.remember(bus, path)

  The publishers do this themselves, without a process. Each new path takes the next slot of a
  ring and forgets the path that was in it. The rows of the table `transient`:

    * `{{path, 0}, ring}` and `{slot, path}` - the rings, from either side
    * `{{:count, ring}, count}` - how many slots were taken so far
    * `{:logged}` - the loss of a last message was logged
    * `{{path, type}, meter}` - see `BB.PubSub.Streams`

  What belongs to a path is written after the path. A writer that finds the path forgotten then
  deletes what it has written, so no row remains without its path.
  """

  alias BB.Path
  alias BB.PubSub.{Bus, Subscription, Subscriptions}

  require Logger

  @plain 1
  @retained 2

  @doc "Returns whether a path is permanent that was not published with this payload type before."
  @spec permanent?(Bus.t(), Path.t()) :: boolean()
  def permanent?(bus, path) do
    has_stream?(bus, path) or
      (not Path.private?(path) and :ets.info(bus.streams, :size) < @most_permanent and
         not member?(bus, path))
  end

  defp has_stream?(bus, path), do: match?({^path, _type}, :ets.next(bus.streams, {path, 0}))

  @doc "Returns whether the path is remembered as a transient one."
  @spec member?(Bus.t(), Path.t()) :: boolean()
  def member?(bus, path), do: :ets.member(bus.transient, {path, 0})

  @doc "Returns whether anything may be kept for the path: it is permanent or remembered."
  @spec known?(Bus.t(), Path.t()) :: boolean()
  def known?(bus, path), do: member?(bus, path) or has_stream?(bus, path)

  @doc "Remembers a transient path, in the slot of the oldest one if there are too many."
  @spec remember(Bus.t(), Path.t()) :: :ok
  def remember(bus, path) do
    if member?(bus, path), do: :ok, else: insert(bus, path)
  end

  # Of several publishers, one inserts the path, and it alone takes a slot.
  defp insert(bus, path) do
    ring = if Bus.retained?(bus, path), do: @retained, else: @plain

    if :ets.insert_new(bus.transient, {{path, 0}, ring}) do
      count = :ets.update_counter(bus.transient, {:count, ring}, 1, {{:count, ring}, 0})
      occupy(bus, {ring, rem(count, @most_transient)}, path)
    else
      :ok
    end
  end

  defp occupy(bus, slot, path) do
    if :ets.insert_new(bus.transient, {slot, path}) do
      :ok
    else
      for {_slot, old} <- :ets.take(bus.transient, slot), do: forget(bus, old)
      occupy(bus, slot, path)
    end
  end

  # The path is deleted first: a process that writes something for it at the same time finds the
  # path gone, and deletes what it has written.
  defp forget(bus, path) do
    :ets.delete(bus.transient, {path, 0})
    delete_meters(bus, path, :ets.next(bus.transient, {path, 0}))

    for subscription <- Subscriptions.reaching(bus, path),
        Subscription.conditional?(subscription) do
      :ets.delete(bus.cells, {subscription.id, path})
    end

    if :ets.take(bus.last, path) != [], do: log_once(bus)
  end

  defp delete_meters(bus, path, {path, _type} = key) do
    :ets.delete(bus.transient, key)
    delete_meters(bus, path, :ets.next(bus.transient, key))
  end

  defp delete_meters(_bus, _path, _next_key), do: :ok

  defp log_once(bus) do
    if :ets.insert_new(bus.transient, {:logged}) do
      Logger.warning(
        "BB.PubSub of #{inspect(bus.robot)} keeps the last messages of the newest " <>
          "#{@most_transient} transient paths (paths with references, or beyond the first " <>
          "#{@most_permanent} streams); it has begun to forget those of older ones"
      )
    end
  end
end

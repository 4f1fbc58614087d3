defmodule BB.PubSub.Passing do
  @most_lasting 4_000
  @most_passing 1_000

  @moduledoc """
  Remembers the newest of the paths that come and go, and forgets the oldest with everything that
  is kept of it.

  A path *lasts* when it is made of atoms and among the first #{@most_lasting} sources of its
  robot: its meters, cells and last message are there as long as the robot. Any other path is
  *passing*: one with a reference, or one more of a publisher that makes ever new ones. The newest
  #{@most_passing} of those are remembered, and beside them the newest #{@most_passing} on which
  messages are kept. Then meters, cells and last message go; on a path that was forgotten
  everything begins anew.

  The publishers themselves do it, without a process: each new path takes the next place of a
  ring, and whoever takes a place forgets the path that stood there. Rows of the table `passing`:

    * `{{path, 0}, ring}` and `{place, path}` - the rings, from either side
    * `{{:turn, ring}, count}` - how many places were taken so far; `{:said}` when a loss was
      logged
    * `{{path, type}, meter}` - see `BB.PubSub.Traffic`

  What belongs to a path is written after the path, and taken back by its writer when the path has
  been forgotten in between: so no row stays without its path.
  """

  alias BB.Path
  alias BB.PubSub.{Bus, Pages, Subscription}

  require Logger

  @plain 1
  @kept 2

  @doc "Whether what is known of the path lasts; it has not been seen with this payload before."
  @spec lasting?(Bus.t(), Path.t()) :: boolean()
  def lasting?(bus, path) do
    seen?(bus, path) or
      (not Path.private?(path) and :ets.info(bus.traffic, :size) < @most_lasting and
         not member?(bus, path))
  end

  @doc "Whether the path has a source that lasts."
  @spec seen?(Bus.t(), Path.t()) :: boolean()
  def seen?(bus, path), do: match?({^path, _type}, :ets.next(bus.traffic, {path, 0}))

  @doc "Whether the path is remembered as a passing one."
  @spec member?(Bus.t(), Path.t()) :: boolean()
  def member?(bus, path), do: :ets.member(bus.passing, {path, 0})

  @doc "Whether what belongs to the path may stay: it lasts, or is remembered."
  @spec known?(Bus.t(), Path.t()) :: boolean()
  def known?(bus, path), do: member?(bus, path) or seen?(bus, path)

  @doc "Remembers a passing path, in the place of the oldest one if there are too many."
  @spec remember(Bus.t(), Path.t()) :: :ok
  def remember(bus, path) do
    if member?(bus, path), do: :ok, else: take_turn(bus, path)
  end

  # One publisher wins the path, and it alone takes a place: no place is taken for nothing.
  defp take_turn(bus, path) do
    ring = if Bus.retained?(bus, path), do: @kept, else: @plain

    if :ets.insert_new(bus.passing, {{path, 0}, ring}) do
      turn = :ets.update_counter(bus.passing, {:turn, ring}, 1, {{:turn, ring}, 0})
      occupy(bus, {ring, rem(turn, @most_passing)}, path)
    else
      :ok
    end
  end

  defp occupy(bus, place, path) do
    if :ets.insert_new(bus.passing, {place, path}) do
      :ok
    else
      for {_place, old} <- :ets.take(bus.passing, place), do: forget(bus, old)
      occupy(bus, place, path)
    end
  end

  # The path first: whoever writes something of it meanwhile finds it gone, and takes it back.
  defp forget(bus, path) do
    :ets.delete(bus.passing, {path, 0})
    forget_meters(bus, path, :ets.next(bus.passing, {path, 0}))

    for subscription <- Pages.above(bus, path), Subscription.gated?(subscription) do
      :ets.delete(bus.cells, {subscription.id, path})
    end

    if :ets.take(bus.last, path) != [], do: say_once(bus)
  end

  defp forget_meters(bus, path, {path, _type} = key) do
    :ets.delete(bus.passing, key)
    forget_meters(bus, path, :ets.next(bus.passing, key))
  end

  defp forget_meters(_bus, _path, _beyond), do: :ok

  defp say_once(bus) do
    if :ets.insert_new(bus.passing, {:said}) do
      Logger.warning(
        "#{inspect(bus.robot)}: of passing paths (with references, or beyond #{@most_lasting} " <>
          "sources) the last messages of the newest #{@most_passing} are kept, older ones are " <>
          "forgotten from now on"
      )
    end
  end
end

defmodule BB.PubSub.Delivery do
  @moduledoc """
  Sends a message to those on its route, in the publisher's process.

  What is sent to a subscription without options is a plain `send/2` for each pid on a list; gates stand only before those that
  asked for them.
  """

  alias BB.Path
  alias BB.PubSub.{Bus, Gate, Routes, Subscription, Traffic}

  @doc "The targets of a plan's steps."
  @spec targets(Bus.t(), [Routes.step()], Path.t()) :: [Routes.target()]
  def targets(bus, steps, path) do
    retained? = Bus.retained?(bus, path)
    for step <- steps, do: target(bus, step, path, retained?)
  end

  defp target(bus, {pid, [taker], shadowed}, path, retained?) do
    others = for %{replay: true} = other <- shadowed, retained?, do: other

    case {Subscription.gated?(taker), others} do
      {true, _} -> {pid, [Gate.new(bus, taker, path, retained?)]}
      {false, []} -> pid
      {false, _} -> {pid, Enum.map(others, &Gate.other_than_replayed(bus, &1, path)) ++ [:plain]}
    end
  end

  defp target(bus, {pid, takers, []}, path, retained?),
    do: {pid, Enum.map(takers, &Gate.new(bus, &1, path, retained?))}

  @doc "Sends to all targets."
  @spec deliver([Routes.target()], term(), pos_integer() | nil) :: :ok
  def deliver([pid | rest], delivery, number) when is_pid(pid) do
    send(pid, delivery)
    deliver(rest, delivery, number)
  end

  def deliver([{pid, gates} | rest], delivery, number) do
    Gate.deliver(gates, pid, delivery, number)
    deliver(rest, delivery, number)
  end

  def deliver([], _delivery, _number), do: :ok

  @doc "Sends to all but some processes, and notes what those did not get. `metered` are the targets' `BB.PubSub.Routes.metered/1`."
  @spec deliver_except(
          Bus.t(),
          {[Routes.target()], [reference() | nil]},
          [pid()],
          term(),
          pos_integer() | nil
        ) ::
          :ok
  def deliver_except(_bus, {targets, _metered}, [], delivery, number),
    do: deliver(targets, delivery, number)

  def deliver_except(bus, {[target | targets], [id | metered]}, except, delivery, number) do
    if process(target) in except,
      do: withheld(bus, id),
      else: deliver([target], delivery, number)

    deliver_except(bus, {targets, metered}, except, delivery, number)
  end

  def deliver_except(_bus, {[], []}, _except, _delivery, _number), do: :ok

  defp process({pid, _gates}), do: pid
  defp process(pid), do: pid

  defp withheld(_bus, nil), do: :ok
  defp withheld(bus, id), do: Traffic.correct(bus, id, {-1, 0})

  @doc "Where there is no route yet: the targets and their `BB.PubSub.Routes.metered/1`, from the subscriptions themselves."
  @spec unrouted(Bus.t(), Path.t(), module()) :: {[Routes.target()], [reference() | nil]}
  def unrouted(bus, path, type) do
    {steps, _filtered} = Routes.plan(Bus.above(bus, path), path, type)
    {targets(bus, steps, path), Routes.metered(steps)}
  end
end

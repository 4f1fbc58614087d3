defmodule BB.PubSub.Delivery do
  @moduledoc """
  Sends a message to those on its route, in the publisher's process.

  What is sent to a subscription without options is a plain `send/2` for each pid on a list; gates
  stand only before those that asked for them.
  """

  alias BB.Path
  alias BB.PubSub.{Bus, Gate, Pages, Routes, Subscription}

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
  @spec deliver([Routes.target()], term(), Gate.stamp()) :: :ok
  def deliver([pid | rest], delivery, number) when is_pid(pid) do
    send(pid, delivery)
    deliver(rest, delivery, number)
  end

  def deliver([{pid, gates} | rest], delivery, number) do
    Gate.deliver(gates, pid, delivery, number)
    deliver(rest, delivery, number)
  end

  def deliver([], _delivery, _number), do: :ok

  @doc """
  Sends to those whom the subscriptions themselves tell, but for some processes, and counts what a
  meter does not tell. For publishers without a route, or with an option.
  """
  @spec unrouted(
          Bus.t(),
          {Path.t(), module(), :lasting | :passing},
          [pid()],
          term(),
          Gate.stamp()
        ) ::
          :ok
  def unrouted(bus, {path, type, class}, except, delivery, number) do
    {steps, filtered} = Routes.plan(Pages.above(bus, path), type)
    retained? = Bus.retained?(bus, path)
    if class == :passing, do: Enum.each(filtered, &Gate.correct(&1.counters, {0, 1}))

    for {pid, [first | _], _shadowed} = step <- steps do
      withheld? = except != [] and pid in except
      unless Subscription.gated?(first), do: count(first.counters, class, withheld?)
      unless withheld?, do: deliver([target(bus, step, path, retained?)], delivery, number)
    end

    :ok
  end

  defp count(counters, :passing, false), do: Gate.correct(counters, {1, 0})
  defp count(counters, :lasting, true), do: Gate.correct(counters, {-1, 0})
  defp count(_counters, _class, _withheld?), do: :ok
end

defmodule BB.PubSub.Cells do
  @moduledoc """
  The cells of a pubsub: the state that a subscription has at one path
  (`BB.PubSub.SubscriptionState`).

  `BB.PubSub.Delivery` and `BB.PubSub.Retention` look them up. A subscription has a cell at each
  path of which it got a message while it had `max_rate`, or `replay` on a retained path. Cells
  are rows `{{subscription_id, path}, cell}` of the pubsub's table `cells`, removed with the
  subscription or when a transient path is forgotten.

      Cells.find(bus, subscription, path, Bus.retained?(bus, path))
  """

  alias BB.Path
  alias BB.PubSub.{Bus, Subscription, Subscriptions, SubscriptionState, TransientPaths}

  @doc """
  Returns the subscription's cell at the path, or `nil` if none of its options needs one there.
  """
  @spec find(Bus.t(), Subscription.t(), Path.t(), boolean()) :: SubscriptionState.cell() | nil
  def find(bus, subscription, path, retained?) do
    if subscription.period_ns != nil or (subscription.replay and retained?),
      do: fetch(bus, subscription, path)
  end

  @doc """
  Returns the subscription's cell at the path, a new one if there is none.

  Every caller gets the same one.
  """
  @spec fetch(Bus.t(), Subscription.t(), Path.t()) :: SubscriptionState.cell()
  def fetch(bus, %{id: id} = subscription, path) do
    case :ets.lookup(bus.cells, {id, path}) do
      [{_, cell}] -> cell
      [] -> insert(bus, subscription, path)
    end
  end

  # A subscription or path that is removed at the same time leaves no cell behind.
  defp insert(bus, %{id: id} = subscription, path) do
    cell = SubscriptionState.new_cell()

    if :ets.insert_new(bus.cells, {{id, path}, cell}) do
      unless Subscriptions.member?(bus, subscription) and TransientPaths.known?(bus, path),
        do: :ets.delete(bus.cells, {id, path})

      cell
    else
      lookup(bus, {id, path}, cell)
    end
  end

  defp lookup(bus, key, default) do
    case :ets.lookup(bus.cells, key) do
      [{_, cell}] -> cell
      [] -> default
    end
  end

  @doc "Deletes all cells of a subscription."
  @spec delete(Bus.t(), Subscription.t()) :: :ok
  def delete(bus, %{id: id} = subscription) do
    if Subscription.conditional?(subscription),
      do: :ets.match_delete(bus.cells, {{id, :_}, :_})

    :ok
  end
end

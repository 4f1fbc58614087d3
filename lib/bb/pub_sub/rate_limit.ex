defmodule BB.PubSub.RateLimit do
  @moduledoc """
  The rate limit of a subscription: the option `max_rate` of `BB.PubSub.subscribe/3`.

  `BB.PubSub.Admission` uses it while a message is published. Each path of a rate-limited
  subscription has a time at which its next message is due. A publisher whose message comes later
  than that moves the time by one period. Of several publishers that do so at once, one succeeds.
  A message that comes earlier is dropped and counted as `dropped` in `BB.PubSub.stats/1`. None is
  kept for later.

      due_ns = RateLimit.due_ns(cell)
      now_ns >= due_ns and RateLimit.reserve?(cell, due_ns, now_ns + period_ns)
  """

  require BB.PubSub.SubscriptionState

  alias BB.PubSub.SubscriptionState

  @doc "Returns when the next message of the cell's path is due, in monotonic nanoseconds."
  @spec due_ns(SubscriptionState.cell()) :: integer()
  def due_ns(cell), do: :atomics.get(cell, SubscriptionState.word(:due_ns))

  @doc "Moves the due time on to `next_ns`; `false` when another publisher has done so before."
  @spec reserve?(SubscriptionState.cell(), integer(), integer()) :: boolean()
  def reserve?(cell, due_ns, next_ns) do
    :atomics.compare_exchange(cell, SubscriptionState.word(:due_ns), due_ns, next_ns) == :ok
  end
end

defmodule BB.PubSub.Plan do
  @moduledoc """
  Works out which processes get a message, and by which of their subscriptions. All functions are
  pure.

  `BB.PubSub.Delivery` and `BB.PubSub.Registrar` turn a plan into sends, `BB.PubSub.Statistics`
  into numbers:

      {steps, filtered} = Plan.new(Subscriptions.reaching(bus, path), type)
  """

  alias BB.PubSub.Subscription

  @typedoc """
  One copy of the message for a process, by the first of these subscriptions that takes it. The
  shadowed subscriptions match too, but add no copy because one of the process's subscriptions is
  `unique`.
  """
  @type step :: {pid(), [Subscription.t(), ...], shadowed :: [Subscription.t()]}

  @doc """
  Returns the steps that deliver a payload of `type`, in order, and the subscriptions to which it
  does not go.

  `subscriptions` are those that the message's path reaches, nearest first.
  """
  @spec new([Subscription.t()], module()) :: {[step()], [Subscription.t()]}
  def new(subscriptions, type) do
    {wanted, filtered} = Enum.split_with(subscriptions, &Subscription.wants?(&1, type))

    case for %{unique: true, pid: pid} <- wanted, into: %{}, do: {pid, []} do
      none when none == %{} -> {for(one <- wanted, do: {one.pid, [one], []}), filtered}
      pids -> wanted |> merge_unique(pids) |> add_shadowed(filtered)
    end
  end

  # A process with a unique subscription gets one copy, at the position of its nearest
  # subscription. An unconditional one makes the others superfluous.
  defp merge_unique(wanted, pids) do
    by_pid = wanted |> Enum.filter(&is_map_key(pids, &1.pid)) |> Enum.group_by(& &1.pid)
    steps(wanted, by_pid)
  end

  defp steps([], _by_pid), do: []

  defp steps([%{pid: pid} = first | rest], by_pid) do
    case by_pid do
      %{^pid => :done} -> steps(rest, by_pid)
      %{^pid => all} -> [step(pid, all) | steps(rest, %{by_pid | pid => :done})]
      _ -> [{pid, [first], []} | steps(rest, by_pid)]
    end
  end

  defp step(pid, subscriptions) do
    case Enum.find(subscriptions, &(not Subscription.conditional?(&1))) do
      nil -> {pid, subscriptions, []}
      plain -> {pid, [plain], List.delete(subscriptions, plain)}
    end
  end

  defp add_shadowed(steps, filtered) do
    {steps, filtered ++ Enum.flat_map(steps, fn {_pid, _takers, shadowed} -> shadowed end)}
  end
end

defmodule BB.Test.Chaos.Core.Verdict do
  @moduledoc """
  What may and what may not follow from kills, told from the supervision tree as it was before. Pure; times in nanoseconds.

  Time in which the whole VM stood still is no warden's: it is taken off.
  """

  alias BB.Test.Chaos.Core.Tree
  alias BB.Test.Chaos.Verdict

  @unwatched_ns 100_000_000
  # A supervisor counts in whole seconds.
  @slack_ns 1_000_000_000

  @typedoc """
  When children of supervisors were killed: what their restarts have used up. One that is started
  anew begins anew.
  """
  @type ledger :: [{supervisor :: pid(), at_ns :: integer()}]

  @doc """
  The places whose processes may be others after the kills of `victims` at `now_ns`, and the ledger with those.

  A process takes all below it along. Its supervisor starts it again, with those that its strategy says; one whose restarts are
  used up ends instead, as if it had been killed itself.
  """
  @spec expected(%{[term()] => Tree.t()}, [[term()]], ledger(), integer()) ::
          {MapSet.t([term()]), ledger()}
  def expected(tree, victims, ledger, now_ns) do
    Enum.reduce(victims, {MapSet.new(), ledger}, fn victim, {places, ledger} ->
      {more, ledger} = ends(tree, victim, ledger, now_ns)
      {MapSet.union(places, MapSet.new(more)), ledger}
    end)
  end

  defp ends(tree, place, ledger, now_ns) do
    parent = tree[Enum.drop(place, -1)]

    cond do
      parent == nil or parent.strategy == :keeper ->
        {branch(tree, place), ledger}

      tree[place].restart == :temporary ->
        {branch(tree, place), ledger}

      # Within the second of doubt it may live on, and has counted one more.
      spent?(parent, ledger, now_ns) ->
        ends(tree, parent.place, [{parent.pid, now_ns} | ledger], now_ns)

      true ->
        {restarted(tree, place, parent), [{parent.pid, now_ns} | ledger]}
    end
  end

  defp spent?(parent, ledger, now_ns) do
    since_ns = now_ns - parent.period_s * 1_000_000_000 - @slack_ns

    count = Enum.count(ledger, fn {pid, at_ns} -> pid == parent.pid and at_ns > since_ns end)

    count + 1 > parent.intensity
  end

  defp restarted(tree, place, parent) do
    order = tree[place].order

    for {sibling, node} <- tree,
        Enum.drop(sibling, -1) == parent.place,
        sibling == place or along?(parent.strategy, node.order > order),
        below <- branch(tree, sibling),
        do: below
  end

  defp along?(:one_for_one, _later?), do: false
  defp along?(:rest_for_one, later?), do: later?
  defp along?(:one_for_all, _later?), do: true

  defp branch(tree, place),
    do: for({below, _} <- tree, List.starts_with?(below, place), do: below)

  @doc """
  The places whose process is another, or gone, and may not be: neither the tree says so nor a dependency on those that it says so
  of: `due?.(place, ended, all)`, of the places before. A place that was not there before has no say.
  """
  @spec innocent(
          %{[term()] => Tree.t()},
          %{[term()] => Tree.t()},
          MapSet.t([term()]),
          ([term()], MapSet.t([term()]), [[term()]] -> boolean())
        ) :: [[term()]]
  def innocent(before, later, expected, due?) do
    for {place, %{pid: pid}} <- before,
        later[place][:pid] != pid,
        place not in expected,
        not due?.(place, expected, Map.keys(before)),
        do: place
  end

  @doc "The times in which a robot was armed without a living warden, as `{robot, from_ns, to_ns}`, that lasted too long."
  @spec unwatched([{module(), integer(), integer()}], [{integer(), integer()}]) ::
          [{module(), integer(), integer()}]
  def unwatched(intervals, standstills) do
    Enum.filter(intervals, fn {_robot, from_ns, to_ns} ->
      to_ns - from_ns - Verdict.overlap(standstills, from_ns, to_ns) > @unwatched_ns
    end)
  end

  @doc """
  What a parameter may be after a request to set it: what was acknowledged and nothing else, or, where the request came to
  nothing that anyone knows, all that it may have been before as well.

      iex> BB.Test.Chaos.Core.Verdict.possible([1], 2, :ok)
      [2]
      iex> BB.Test.Chaos.Core.Verdict.possible([1], 2, :unknown)
      [2, 1]
  """
  @spec possible([term()], term(), :ok | :unknown) :: [term()]
  def possible(_before, value, :ok), do: [value]
  def possible(before, value, :unknown), do: [value | before]

  @doc "Whether a value was lost: what a parameter is, where that can be known, is none of what it may be."
  @spec lost?({:ok, term()} | :unknown, [term()]) :: boolean()
  def lost?(:unknown, _possible), do: false
  def lost?({:ok, value}, possible), do: value not in possible
end

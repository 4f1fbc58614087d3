defmodule BB.Test.Chaos.Core.Verdict do
  @moduledoc """
  Decides which restarts may follow from kills, from the supervision tree before them. Pure; times
  in nanoseconds.

  Time in which the whole VM stood still is subtracted.
  """

  alias BB.Test.Chaos.Core.Tree
  alias BB.Test.Chaos.Verdict

  @unwatched_ns 100_000_000
  # A supervisor counts in whole seconds.
  @slack_ns 1_000_000_000

  @typedoc """
  The restarts that supervisors have used up by the kills. A restarted supervisor begins with
  none.
  """
  @type ledger :: [{supervisor :: pid(), at_ns :: integer()}]

  @doc """
  Returns the places whose processes may restart after the kills of `victims` at `now_ns`, and the
  updated ledger.

  The end of a process takes all processes below it with it. Its supervisor restarts it, with
  those that its strategy names. A supervisor that reaches its restart limit ends instead, as if
  it had been killed itself.
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

      # Within the doubtful second it may survive, with one more restart counted.
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
  Returns the places whose process has restarted, or is gone, without a reason.

  A reason is the supervision tree, or a dependency on a place that the tree explains:
  `due?.(place, ended, all)`, for the places before. A place that did not exist before is not
  judged.
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

  @doc """
  Returns the times in which a robot was armed without a living warden for too long, as `{robot,
  from_ns, to_ns}`.
  """
  @spec unwatched([{module(), integer(), integer()}], [{integer(), integer()}]) ::
          [{module(), integer(), integer()}]
  def unwatched(intervals, standstills) do
    Enum.filter(intervals, fn {_robot, from_ns, to_ns} ->
      to_ns - from_ns - Verdict.overlap(standstills, from_ns, to_ns) > @unwatched_ns
    end)
  end

  @doc """
  Returns the possible values of a parameter after a request to set it.

  After an acknowledged request, that is the new value. If the result of the request is unknown,
  all previously possible values remain possible.

      iex> BB.Test.Chaos.Core.Verdict.possible([1], 2, :ok)
      [2]
      iex> BB.Test.Chaos.Core.Verdict.possible([1], 2, :unknown)
      [2, 1]
  """
  @spec possible([term()], term(), :ok | :unknown) :: [term()]
  def possible(_before, value, :ok), do: [value]
  def possible(before, value, :unknown), do: [value | before]

  @doc """
  Tells whether a value was lost: whether a known value of a parameter is none of the possible
  ones.
  """
  @spec lost?({:ok, term()} | :unknown, [term()]) :: boolean()
  def lost?(:unknown, _possible), do: false
  def lost?({:ok, value}, possible), do: value not in possible
end

defmodule BB.PubSub.Routes do
  @moduledoc """
  Where a message goes, worked out before it is published. Everything here is a function of its arguments.

  Routes are a tree of maps, a level for each segment; below a path's last segment, at the key `[]`, stands a map from payload
  types to routes. So a publisher finds its route by as many small lookups as the path has segments, and subscriptions
  elsewhere in the tree, or of other types, are not in it.
  """

  alias BB.Path
  alias BB.PubSub.{Subscription, Traffic}

  @type t :: %{optional(Path.segment()) => t(), optional([]) => %{module() => route()}}

  @typedoc """
  The meter of the source; who receives it; for each of those the subscription that counts by the meter, if any; and the
  sequence of a retained path's numbers.
  """
  @type route ::
          {Traffic.meter(), [target()], [reference() | nil], :atomics.atomics_ref() | nil}

  @typedoc "A process that gets the message, or one that gets it through one of these gates."
  @type target :: pid() | {pid(), [BB.PubSub.Gate.t()]}

  @typedoc """
  One copy to a process, by the first of these subscriptions that takes it. The shadowed ones would have got it too, were it
  not for the one copy.
  """
  @type step :: {pid(), [Subscription.t(), ...], shadowed :: [Subscription.t()]}

  @doc "No routes."
  @spec new() :: t()
  def new, do: %{}

  @doc "The route of a source."
  @spec find(t(), Path.t(), module()) :: route() | nil
  def find(routes, [segment | rest], type) do
    case routes do
      %{^segment => below} -> find(below, rest, type)
      _ -> nil
    end
  end

  def find(%{[] => types}, [], type) do
    case types do
      %{^type => route} -> route
      _ -> nil
    end
  end

  def find(_routes, _path, _type), do: nil

  @doc "Puts the route of a source."
  @spec put(t(), Path.t(), module(), route()) :: t()
  def put(routes, [segment | rest], type, route),
    do: Map.put(routes, segment, put(Map.get(routes, segment, %{}), rest, type, route))

  def put(routes, [], type, route),
    do: Map.update(routes, [], %{type => route}, &Map.put(&1, type, route))

  @doc "For each step the subscription that counts by the source's meter, `nil` where gates count."
  @spec metered([step()]) :: [reference() | nil]
  def metered(steps) do
    for {_pid, [first | _], _shadowed} <- steps,
        do: if(Subscription.gated?(first), do: nil, else: first.id)
  end

  @doc "The sources at and below a prefix."
  @spec below(t(), Path.t()) :: [{Path.t(), module()}]
  def below(routes, prefix) do
    case at(routes, prefix) do
      nil -> []
      node -> sources(node, prefix)
    end
  end

  defp at(node, []), do: node
  defp at(node, [segment | rest]), do: node[segment] && at(node[segment], rest)

  defp sources(node, path) do
    Enum.flat_map(node, fn
      {[], types} -> for {type, _route} <- types, do: {path, type}
      {segment, below} -> sources(below, path ++ [segment])
    end)
  end

  @doc """
  Who gets what is published at `path` with a payload of `type`: the steps to take, in order, and the subscriptions that hear of
  the path but do not get it.

  `subscriptions` are those at the path and above it, nearest first.
  """
  @spec plan([Subscription.t()], Path.t(), module()) :: {[step()], [Subscription.t()]}
  def plan(subscriptions, path, type) do
    reached = Enum.filter(subscriptions, &Subscription.reaches?(&1, path))
    {wanted, filtered} = Enum.split_with(reached, &Subscription.wants?(&1, type))

    steps =
      case for %{unique: true, pid: pid} <- wanted, uniq: true, do: pid do
        [] -> for subscription <- wanted, do: {subscription.pid, [subscription], []}
        pids -> one_step_each(wanted, pids)
      end

    {steps, filtered ++ Enum.flat_map(steps, fn {_pid, _takers, shadowed} -> shadowed end)}
  end

  # A process with a unique subscription gets one copy, where the nearest of its subscriptions stands. One that takes
  # everything makes the others superfluous.
  defp one_step_each([], _pids), do: []

  defp one_step_each([%{pid: pid} = first | rest], pids) do
    if pid in pids do
      {others, rest} = Enum.split_with(rest, &(&1.pid == pid))
      [step(pid, [first | others]) | one_step_each(rest, pids)]
    else
      [{pid, [first], []} | one_step_each(rest, pids)]
    end
  end

  defp step(pid, subscriptions) do
    case Enum.find(subscriptions, &(not Subscription.gated?(&1))) do
      nil -> {pid, subscriptions, []}
      plain -> {pid, [plain], List.delete(subscriptions, plain)}
    end
  end
end

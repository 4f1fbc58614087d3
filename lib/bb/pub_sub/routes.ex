defmodule BB.PubSub.Routes do
  @moduledoc """
  Where a message goes, worked out before it is published. Everything here is a function of its arguments.

  A publisher's message touches as little memory as can be: the last segment of a path, which tells most paths apart, is looked
  up in a map and leads to the few sources that end in it. Where many do, there is a map of those. Subscriptions elsewhere, or
  for other types, are not in it.
  """

  alias BB.Path
  alias BB.PubSub.{Subscription, Traffic}

  @few 8

  @type t :: %{(Path.segment() | nil) => [route()] | %{{Path.t(), module()} => route()}}

  @typedoc """
  A source, its meter, and who receives what it publishes; for each of those the subscription that counts by the meter, if
  any; and the sequence of a retained path's numbers.
  """
  @type route ::
          {Path.t(), module(), Traffic.meter() | nil, [target()], [reference() | nil],
           :atomics.atomics_ref() | nil}

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

  @doc "The route of a source. A path that is no list of segments has none."
  @spec find(t(), Path.t(), module()) :: route() | nil
  def find(routes, path, type) do
    last = last(path)

    case routes do
      %{^last => few} when is_list(few) -> among(few, path, type)
      %{^last => %{{^path, ^type} => route}} -> route
      _ -> nil
    end
  end

  defp last([segment]), do: segment
  defp last([_ | rest]), do: last(rest)
  defp last(_), do: nil

  defp among([{path, type, _, _, _, _} = route | _], path, type), do: route
  defp among([_ | rest], path, type), do: among(rest, path, type)
  defp among([], _path, _type), do: nil

  @doc "Puts the route of its source."
  @spec put(t(), route()) :: t()
  def put(routes, route) do
    last = last(elem(route, 0))
    Map.put(routes, last, routes |> Map.get(last, []) |> put_among(route))
  end

  defp put_among(many, route) when is_map(many), do: Map.put(many, source(route), route)

  defp put_among(few, route) do
    source = source(route)
    few = [route | Enum.reject(few, &(source(&1) == source))]
    if length(few) > @few, do: Map.new(few, &{source(&1), &1}), else: few
  end

  defp source({path, type, _, _, _, _}), do: {path, type}

  @doc "For each step the subscription that counts by the source's meter, `nil` where gates count."
  @spec metered([step()]) :: [reference() | nil]
  def metered(steps) do
    for {_pid, [first | _], _shadowed} <- steps,
        do: if(Subscription.gated?(first), do: nil, else: first.id)
  end

  @doc "The sources at and below a prefix."
  @spec below(t(), Path.t()) :: [{Path.t(), module()}]
  def below(routes, prefix) do
    for {_last, sources} <- routes,
        {path, type} <- sources(sources),
        Path.prefix?(prefix, path),
        do: {path, type}
  end

  @doc "Whether publishers have a route for anything at or below a prefix; a source without a meter has none yet."
  @spec routed?(t(), Path.t()) :: boolean()
  def routed?(routes, prefix) do
    Enum.any?(routes, fn {_last, few_or_many} ->
      Enum.any?(
        routes_of(few_or_many),
        &(elem(&1, 2) != nil and Path.prefix?(prefix, elem(&1, 0)))
      )
    end)
  end

  defp routes_of(few) when is_list(few), do: few
  defp routes_of(many), do: Map.values(many)

  defp sources(few) when is_list(few), do: Enum.map(few, &source/1)
  defp sources(many), do: Map.keys(many)

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

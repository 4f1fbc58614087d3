defmodule BB.PubSub.Routes do
  @moduledoc """
  Where a message goes, worked out before it is published. Everything here is a function of its
  arguments.

  A publisher's message touches as little memory as can be: the last segment of a path, which
  tells most paths apart, is looked up in a map and leads to the few sources that end in it. Where
  many do, there is a map of those. Subscriptions elsewhere, or for other types, are not in it.
  """

  alias BB.Path
  alias BB.PubSub.{Subscription, Traffic}

  @few 8

  @type t :: %{(Path.segment() | nil) => [route()] | %{{Path.t(), module()} => route()}}

  @typedoc """
  A source, its meter, and who receives what it publishes; the version of the route, which
  publishers may take as long as it is that of the meter; and the sequence of a retained path's
  numbers.
  """
  @type route ::
          {Path.t(), module(), Traffic.meter(), [target()], version :: non_neg_integer(),
           :atomics.atomics_ref() | nil}

  @typedoc "A process that gets the message, or one that gets it through one of these gates."
  @type target :: pid() | {pid(), [BB.PubSub.Gate.t()]}

  @typedoc """
  One copy to a process, by the first of these subscriptions that takes it. The shadowed ones
  would have got it too, were it not for the one copy.
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

  @doc "Takes the route of a source away, if there is one."
  @spec delete(t(), {Path.t(), module()}) :: t()
  def delete(routes, {path, _type} = source) do
    last = last(path)

    case delete_among(Map.get(routes, last, []), source) do
      [] -> Map.delete(routes, last)
      left -> Map.put(routes, last, left)
    end
  end

  defp delete_among(many, source) when is_map(many), do: Map.delete(many, source)
  defp delete_among(few, source), do: Enum.reject(few, &(source(&1) == source))

  @doc """
  Who gets a payload of `type`: the steps to take, in order, and the subscriptions that hear of it
  but do not get it.

  `subscriptions` are those that hear of the path, nearest first.
  """
  @spec plan([Subscription.t()], module()) :: {[step()], [Subscription.t()]}
  def plan(subscriptions, type) do
    {wanted, filtered} = Enum.split_with(subscriptions, &Subscription.wants?(&1, type))

    case for %{unique: true, pid: pid} <- wanted, into: %{}, do: {pid, []} do
      none when none == %{} -> {for(one <- wanted, do: {one.pid, [one], []}), filtered}
      pids -> wanted |> one_step_each(pids) |> and_shadowed(filtered)
    end
  end

  # A process with a unique subscription gets one copy, where the nearest of its subscriptions
  # stands. One that takes everything makes the others superfluous.
  defp one_step_each(wanted, pids) do
    of_each = wanted |> Enum.filter(&is_map_key(pids, &1.pid)) |> Enum.group_by(& &1.pid)
    steps(wanted, of_each)
  end

  defp steps([], _of_each), do: []

  defp steps([%{pid: pid} = first | rest], of_each) do
    case of_each do
      %{^pid => :done} -> steps(rest, of_each)
      %{^pid => all} -> [step(pid, all) | steps(rest, %{of_each | pid => :done})]
      _ -> [{pid, [first], []} | steps(rest, of_each)]
    end
  end

  defp step(pid, subscriptions) do
    case Enum.find(subscriptions, &(not Subscription.gated?(&1))) do
      nil -> {pid, subscriptions, []}
      plain -> {pid, [plain], List.delete(subscriptions, plain)}
    end
  end

  defp and_shadowed(steps, filtered) do
    {steps, filtered ++ Enum.flat_map(steps, fn {_pid, _takers, shadowed} -> shadowed end)}
  end
end

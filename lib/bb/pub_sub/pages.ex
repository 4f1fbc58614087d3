defmodule BB.PubSub.Pages do
  @moduledoc """
  Who is subscribed where. The registrar writes it; publishers without a route read it.

  The subscriptions of a path stand on pages of a few dozen, so that one more or one less costs
  the same however many there are:

    * `subscriptions` - `{path, [page]}`, the numbers of a path's pages in the order of
      subscribing, and `{{path, page}, [subscription]}`
    * `places` - `{{pid, path, page}}`, the pages on which a process stands

  A reader that meets a page which is being made or emptied sees one subscription less, never one
  twice. A writer that dies between two steps leaves at most a place where the process does not
  stand.
  """

  alias BB.Path
  alias BB.PubSub.{Bus, Subscription}

  @full 32

  @type page :: non_neg_integer()

  @doc "The subscriptions at exactly that path, oldest first."
  @spec at(Bus.t(), Path.t()) :: [Subscription.t()]
  def at(bus, path) do
    case numbers(bus, path) do
      [] -> []
      [only] -> page(bus, path, only)
      many -> Enum.flat_map(many, &page(bus, path, &1))
    end
  end

  @doc "The subscriptions that hear of what is published at the path, nearest first."
  @spec above(Bus.t(), Path.t()) :: [Subscription.t()]
  def above(bus, path) do
    at(bus, path) ++
      for level <- Path.ancestors(path), subscription <- at(bus, level), not subscription.exact do
        subscription
      end
  end

  @doc "All subscriptions."
  @spec all(Bus.t()) :: [Subscription.t()]
  def all(bus) do
    for {{_path, _page}, list} <- :ets.tab2list(bus.subscriptions), one <- list, do: one
  end

  @doc "The subscriptions of a process: of deeper paths first, of one path oldest first."
  @spec of(Bus.t(), pid()) :: [Subscription.t()]
  def of(bus, pid) do
    mine =
      for {path, page} <- places(bus, pid), %{pid: ^pid} = one <- page(bus, path, page), do: one

    Enum.sort_by(mine, &(-length(&1.path)))
  end

  @doc "The paths at which a process has subscribed."
  @spec paths(Bus.t(), pid()) :: [Path.t()]
  def paths(bus, pid), do: bus |> places(pid) |> Enum.map(&elem(&1, 0)) |> Enum.dedup()

  @doc "Whether a process has subscribed anywhere."
  @spec anywhere?(Bus.t(), pid()) :: boolean()
  def anywhere?(bus, pid), do: match?({^pid, _, _}, :ets.next(bus.places, {pid, 0, 0}))

  @doc "Whether a process has subscribed at exactly that path."
  @spec at?(Bus.t(), pid(), Path.t()) :: boolean()
  def at?(bus, pid, path),
    do: match?({^pid, ^path, _}, :ets.next(bus.places, {pid, path, -1}))

  @doc "Whether the subscription is there."
  @spec member?(Bus.t(), Subscription.t()) :: boolean()
  def member?(bus, %{id: id, pid: pid, path: path}) do
    Enum.any?(places(bus, pid, path), fn page ->
      page in numbers(bus, path) and Enum.any?(page(bus, path, page), &(&1.id == id))
    end)
  end

  @doc "Adds a subscription behind all others of its path."
  @spec add(Bus.t(), Subscription.t()) :: :ok
  def add(bus, %{path: path} = subscription) do
    {number, list} = last(bus, path)
    :ets.insert(bus.places, {{subscription.pid, path, number}})
    :ets.insert(bus.subscriptions, {{path, number}, list ++ [subscription]})
    :ok
  end

  # The last page, or a new one when that is full.
  defp last(bus, path) do
    numbers = numbers(bus, path)
    last = List.last(numbers)
    list = if last, do: page(bus, path, last), else: []

    if last != nil and length(list) < @full do
      {last, list}
    else
      number = if last, do: last + 1, else: 0
      :ets.insert(bus.subscriptions, {path, numbers ++ [number]})
      {number, []}
    end
  end

  @doc "Removes what a process has at a path. Returns it."
  @spec remove(Bus.t(), pid(), Path.t()) :: [Subscription.t()]
  def remove(bus, pid, path) do
    for page <- places(bus, pid, path), gone <- take(bus, pid, path, page), do: gone
  end

  defp take(bus, pid, path, page) do
    {gone, left} = Enum.split_with(page(bus, path, page), &(&1.pid == pid))
    if left == [], do: drop(bus, path, page), else: rewrite(bus, {path, page}, left)
    :ets.delete(bus.places, {pid, path, page})
    gone
  end

  defp rewrite(bus, key, list), do: :ets.insert(bus.subscriptions, {key, list})

  defp drop(bus, path, page) do
    case List.delete(numbers(bus, path), page) do
      [] -> :ets.delete(bus.subscriptions, path)
      numbers -> :ets.insert(bus.subscriptions, {path, numbers})
    end

    :ets.delete(bus.subscriptions, {path, page})
  end

  defp numbers(bus, path), do: value(bus, path)
  defp page(bus, path, number), do: value(bus, {path, number})

  defp value(bus, key) do
    case :ets.lookup(bus.subscriptions, key) do
      [{_, list}] -> list
      [] -> []
    end
  end

  # A path may hold any atom, also those that mean something in a match: so keys are walked, not
  # matched. A number comes before every path and every page.
  defp places(bus, pid), do: walk_pid(bus, pid, :ets.next(bus.places, {pid, 0, 0}))

  defp walk_pid(bus, pid, {pid, path, page} = key),
    do: [{path, page} | walk_pid(bus, pid, :ets.next(bus.places, key))]

  defp walk_pid(_bus, _pid, _beyond), do: []

  defp places(bus, pid, path),
    do: walk_path(bus, pid, path, :ets.next(bus.places, {pid, path, -1}))

  defp walk_path(bus, pid, path, {pid, path, page} = key),
    do: [page | walk_path(bus, pid, path, :ets.next(bus.places, key))]

  defp walk_path(_bus, _pid, _path, _beyond), do: []
end

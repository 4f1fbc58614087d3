defmodule BB.PubSub.Subscriptions do
  @moduledoc """
  All subscriptions of a pubsub, by path and by process.

  `BB.PubSub.Registrar` writes them. Publishers without a route read them, as do the functions
  that list subscribers:

      Subscriptions.reaching(bus, [:sensor, :base_link, :imu])

  The subscriptions of a path are on pages of up to 32, so adding or removing one costs the same
  however many there are. The tables:

    * `subscriptions` - `{path, [page]}`, the numbers of a path's pages in the order of
      subscribing, and `{{path, page}, [subscription]}`
    * `places` - `{{pid, path, page}}`, the pages that hold a process's subscriptions

  A reader that meets a page while it is created or emptied may miss one subscription, and never
  gets one twice. A writer that dies between two steps leaves at most a row of `places` for a page
  that does not hold the process.
  """

  alias BB.Path
  alias BB.PubSub.{Bus, Subscription}

  @page_size 32

  @type page :: non_neg_integer()

  @doc "Returns the subscriptions at exactly this path, oldest first."
  @spec at(Bus.t(), Path.t()) :: [Subscription.t()]
  def at(bus, path) do
    case numbers(bus, path) do
      [] -> []
      [only] -> page(bus, path, only)
      many -> Enum.flat_map(many, &page(bus, path, &1))
    end
  end

  @doc "Returns the subscriptions that a message published at the path reaches, nearest first."
  @spec reaching(Bus.t(), Path.t()) :: [Subscription.t()]
  def reaching(bus, path) do
    at(bus, path) ++
      for level <- Path.ancestors(path), subscription <- at(bus, level), not subscription.exact do
        subscription
      end
  end

  @doc "Returns all subscriptions."
  @spec all(Bus.t()) :: [Subscription.t()]
  def all(bus) do
    for {{_path, _page}, list} <- :ets.tab2list(bus.subscriptions), one <- list, do: one
  end

  @doc """
  Returns the subscriptions of a process: longer paths first, and oldest first at each path.
  """
  @spec of(Bus.t(), pid()) :: [Subscription.t()]
  def of(bus, pid) do
    mine =
      for {path, page} <- places(bus, pid), %{pid: ^pid} = one <- page(bus, path, page), do: one

    Enum.sort_by(mine, &(-length(&1.path)))
  end

  @doc "Returns the paths at which a process is subscribed."
  @spec paths(Bus.t(), pid()) :: [Path.t()]
  def paths(bus, pid), do: bus |> places(pid) |> Enum.map(&elem(&1, 0)) |> Enum.dedup()

  @doc "Returns whether a process has any subscription."
  @spec anywhere?(Bus.t(), pid()) :: boolean()
  def anywhere?(bus, pid), do: match?({^pid, _, _}, :ets.next(bus.places, {pid, 0, 0}))

  @doc "Returns whether a process is subscribed at exactly this path."
  @spec at?(Bus.t(), pid(), Path.t()) :: boolean()
  def at?(bus, pid, path),
    do: match?({^pid, ^path, _}, :ets.next(bus.places, {pid, path, -1}))

  @doc "Returns whether the subscription is among them."
  @spec member?(Bus.t(), Subscription.t()) :: boolean()
  def member?(bus, %{id: id, pid: pid, path: path}) do
    Enum.any?(places(bus, pid, path), fn page ->
      page in numbers(bus, path) and Enum.any?(page(bus, path, page), &(&1.id == id))
    end)
  end

  @doc "Adds a subscription after all others of its path."
  @spec add(Bus.t(), Subscription.t()) :: :ok
  def add(bus, %{path: path} = subscription) do
    {number, list} = last_page(bus, path)
    :ets.insert(bus.places, {{subscription.pid, path, number}})
    :ets.insert(bus.subscriptions, {{path, number}, list ++ [subscription]})
    :ok
  end

  # Adds a page when the last one is full.
  defp last_page(bus, path) do
    numbers = numbers(bus, path)
    last = List.last(numbers)
    list = if last, do: page(bus, path, last), else: []

    if last != nil and length(list) < @page_size do
      {last, list}
    else
      number = if last, do: last + 1, else: 0
      :ets.insert(bus.subscriptions, {path, numbers ++ [number]})
      {number, []}
    end
  end

  @doc "Removes the subscriptions of a process at exactly this path and returns them."
  @spec remove(Bus.t(), pid(), Path.t()) :: [Subscription.t()]
  def remove(bus, pid, path) do
    for page <- places(bus, pid, path), one <- remove(bus, pid, path, page), do: one
  end

  defp remove(bus, pid, path, page) do
    {removed, left} = Enum.split_with(page(bus, path, page), &(&1.pid == pid))

    if left == [],
      do: delete_page(bus, path, page),
      else: :ets.insert(bus.subscriptions, {{path, page}, left})

    :ets.delete(bus.places, {pid, path, page})
    removed
  end

  defp delete_page(bus, path, page) do
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

  # A path may contain atoms with a meaning in match specifications, such as :_. So the keys are
  # walked, not matched. Numbers sort before paths, and -1 before all pages.
  defp places(bus, pid), do: walk_pid(bus, pid, :ets.next(bus.places, {pid, 0, 0}))

  defp walk_pid(bus, pid, {pid, path, page} = key),
    do: [{path, page} | walk_pid(bus, pid, :ets.next(bus.places, key))]

  defp walk_pid(_bus, _pid, _next_key), do: []

  defp places(bus, pid, path),
    do: walk_path(bus, pid, path, :ets.next(bus.places, {pid, path, -1}))

  defp walk_path(bus, pid, path, {pid, path, page} = key),
    do: [page | walk_path(bus, pid, path, :ets.next(bus.places, key))]

  defp walk_path(_bus, _pid, _path, _next_key), do: []
end

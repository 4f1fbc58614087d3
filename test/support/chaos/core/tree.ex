defmodule BB.Test.Chaos.Core.Tree do
  @moduledoc """
  A snapshot of a supervision tree: which process runs under which supervisor, and which restarts
  follow from an end.
  """

  alias BB.Component.Keeper

  @patience_ms 5_000

  @typedoc """
  A process by its place: the ids from the root on.

  A keeper restarts its one child without limit, and restarts no other.
  """
  @type t :: %{
          place: [term()],
          pid: pid(),
          order: non_neg_integer(),
          restart: :permanent | :transient | :temporary,
          strategy: nil | :one_for_one | :one_for_all | :rest_for_one | :keeper,
          intensity: nil | non_neg_integer(),
          period_s: nil | pos_integer()
        }

  @doc """
  Returns all processes below the roots, given by their registered names, and the roots
  themselves. A root that does not run, or is below another, is left out.
  """
  @spec snapshot([atom()]) :: %{[term()] => t()}
  def snapshot(roots) do
    Enum.reduce(roots, %{}, fn name, tree ->
      case Process.whereis(name) do
        nil -> tree
        pid -> if below?(tree, pid), do: tree, else: Map.merge(tree, root(name, pid))
      end
    end)
  end

  defp below?(tree, pid), do: Enum.any?(tree, fn {_place, node} -> node.pid == pid end)

  defp root(name, pid) do
    for node <- branch([name], pid, 0, :permanent, :supervisor), into: %{}, do: {node.place, node}
  end

  defp branch(place, pid, order, restart, :worker),
    do: [node(place, pid, order, restart, %{strategy: nil, intensity: nil, period_s: nil})]

  defp branch(place, pid, order, restart, :supervisor) do
    with {:ok, rules} <- rules(pid), {:ok, children} <- children(pid, rules.strategy) do
      below =
        for {{id, child, type, restart}, order} <- Enum.with_index(children),
            node <- branch(place ++ [id], child, order, restart, type),
            do: node

      [node(place, pid, order, restart, rules) | below]
    else
      # The supervisor has just ended.
      :error -> []
    end
  end

  defp node(place, pid, order, restart, rules),
    do: Map.merge(rules, %{place: place, pid: pid, order: order, restart: restart})

  # In the order of their starts: `{id, pid, type, restart}`.
  defp children(pid, strategy) do
    with {:ok, listed} <- call(pid, :which_children) do
      children = for {id, child, type, _} when is_pid(child) <- listed, do: {id, child, type}
      {:ok, children |> Enum.reverse() |> Enum.map(&named(&1, pid, strategy))}
    end
  end

  defp named({:undefined, child, type}, parent, _strategy),
    do: {dynamic_id(child, parent), child, type, :permanent}

  defp named({id, child, type}, _keeper, :keeper), do: {id, child, type, :permanent}
  defp named({id, child, type}, parent, _strategy), do: {id, child, type, restart(parent, id)}

  # Its name, if it has one, and otherwise its start arguments.
  defp dynamic_id(child, parent) do
    with {:registered_name, name} when is_atom(name) <- Process.info(child, :registered_name) do
      name
    else
      _nameless -> started_with(state(parent), child)
    end
  end

  defp started_with({:ok, %DynamicSupervisor{children: children}}, child) do
    case children do
      %{^child => {{module, _, arguments}, _, _, _, _}} -> {module, :erlang.phash2(arguments)}
      _gone -> child
    end
  end

  defp started_with(_state, child), do: child

  defp restart(parent, id) do
    case call(parent, {:get_childspec, id}) do
      {:ok, {:ok, %{restart: restart}}} -> restart
      _none -> :permanent
    end
  end

  defp rules(pid) do
    with {:ok, state} <- state(pid), do: {:ok, read(state)}
  end

  # In all releases of OTP, a supervisor's state begins with name, strategy, children, dynamics,
  # intensity, period.
  defp read(state) when elem(state, 0) == :state do
    %{strategy: strategy(elem(state, 2)), intensity: elem(state, 5), period_s: elem(state, 6)}
  end

  defp read(%DynamicSupervisor{max_restarts: intensity, max_seconds: period_s}),
    do: %{strategy: :one_for_one, intensity: intensity, period_s: period_s}

  defp read(%Keeper{}), do: %{strategy: :keeper, intensity: nil, period_s: nil}

  defp strategy(:simple_one_for_one), do: :one_for_one
  defp strategy(strategy), do: strategy

  defp state(pid) do
    {:ok, :sys.get_state(pid, @patience_ms)}
  catch
    :exit, _gone -> :error
  end

  defp call(pid, request) do
    {:ok, GenServer.call(pid, request, @patience_ms)}
  catch
    :exit, _gone -> :error
  end
end

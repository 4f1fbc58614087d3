defmodule BB.Dsl.Estimators do
  @moduledoc """
  The rules for the estimators of a robot: their inputs, paths and commands. Pure.
  `BB.Dsl.Builder` checks them once the declaration is complete, because an input may be declared
  below the estimator that reads it.
  """
  @moduledoc no_example: "internal: its mistakes are BB.Dsl.Error messages"

  alias BB.Dsl.Node

  @doc "Checks an estimator of a complete declaration."
  @spec check(Node.t(), Node.t()) :: :ok | {:error, String.t()}
  def check(%Node{kind: :estimator} = node, root) do
    with :ok <- check_commands(node, root),
         :ok <- check_inputs(node, Node.nodes(node, :input)),
         :ok <- check_paths(node, root),
         :ok <- check_cycle(node, estimators(root)) do
      :ok
    else
      {:error, reason} -> {:error, "#{Node.describe(node)}: #{reason}"}
    end
  end

  def check(_node, _root), do: :ok

  defp check_commands(node, root) do
    known = for command <- Node.in_sections(root, :commands, :command), do: command.name

    Enum.find_value([:on_degraded, :on_lost, :on_recovered], :ok, fn field ->
      name = node.fields[field]

      if name != nil and name not in known do
        {:error, "#{field} references unknown command #{inspect(name)}; declare it in `commands`"}
      end
    end)
  end

  defp check_inputs(%{parent: :sensor} = node, _inputs), do: check_sync(node, 1)

  defp check_inputs(_node, []),
    do:
      {:error,
       "an estimator in a link must declare at least one `input`; add `input :name, path`"}

  defp check_inputs(node, [_one]), do: check_sync(node, 1)

  defp check_inputs(_node, inputs) do
    case Enum.filter(inputs, & &1.fields[:driver?]) do
      [_driver] ->
        :ok

      [] ->
        {:error, "several inputs and no driver; add `driver?: true` to one of them"}

      drivers ->
        {:error, "multiple driver inputs: #{names(drivers)}; keep `driver?: true` in one of them"}
    end
  end

  defp check_sync(%{fields: %{sync_tolerance: _}}, 1) do
    {:error, "single input but declares `sync_tolerance`; remove it, or declare another input"}
  end

  defp check_sync(_node, _inputs), do: :ok

  defp check_paths(node, root) do
    known = topics(root)

    Enum.find_value(Node.nodes(node, :input), :ok, fn input ->
      if input.fields.path not in known do
        {:error,
         "input #{inspect(input.name)} has the unknown path #{inspect(input.fields.path)}; " <>
           "name the path of a sensor or an estimator, such as #{inspect(List.first(known))}"}
      end
    end)
  end

  defp topics(root) do
    for node <- Node.all(root), topic <- outputs(node), do: topic
  end

  @doc "Returns the paths on which a sensor or an estimator of a declaration publishes."
  @spec outputs(Node.t()) :: [[atom()]]
  def outputs(%Node{kind: :sensor} = node), do: [[:sensor | tl(node.path)]]

  def outputs(%Node{kind: :estimator} = node) do
    own = [if(node.parent == :sensor, do: :sensor, else: :estimator) | tl(node.path)]
    [own | for(output <- Node.nodes(node, :output), path = output.fields[:path], do: path)]
  end

  def outputs(_node), do: []

  defp estimators(root), do: Enum.filter(Node.all(root), &(&1.kind == :estimator))

  # The estimators that a first one reads, and those that they read, and so on.
  defp check_cycle(node, all) do
    sources = sources(node, all)

    cond do
      node in sources ->
        {:error, "self-cycle: it reads its own output; name another input"}

      cycle = find_cycle(sources, node, all, [node]) ->
        {:error, "cycle: #{Enum.map_join(cycle, " reads ", &inspect(&1.name))}; break it"}

      true ->
        :ok
    end
  end

  defp sources(node, all) do
    paths = for input <- Node.nodes(node, :input), do: input.fields.path
    Enum.filter(all, fn other -> Enum.any?(outputs(other), &(&1 in paths)) end)
  end

  defp find_cycle(sources, first, all, above) do
    Enum.find_value(sources, fn source ->
      cond do
        source == first -> Enum.reverse([first | above])
        source in above -> nil
        true -> source |> sources(all) |> find_cycle(first, all, [source | above])
      end
    end)
  end

  defp names(nodes), do: Enum.map_join(nodes, " and ", &inspect(&1.name))
end

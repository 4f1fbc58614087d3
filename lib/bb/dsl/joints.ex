defmodule BB.Dsl.Joints do
  @moduledoc """
  The rules for joints: what a joint of each type must have, may have, and in which units. Pure.
  `BB.Dsl.Rules` checks them when a joint's declaration ends.

  | type | limit | axis | dynamics |
  |---|---|---|---|
  | `:revolute`, `:prismatic` | required | optional | optional |
  | `:continuous` | optional, without `lower` and `upper` | optional | optional |
  | `:planar` | optional, without `lower` and `upper` | required | optional |
  | `:floating`, `:fixed` | refused | refused | refused |
  """
  @moduledoc no_example: "internal: its mistakes are BB.Dsl.Error messages"

  alias BB.Dsl.{Grammar, Node, Quantities}
  alias BB.Unit

  @unlimited [:continuous, :planar]
  @rigid [:fixed, :floating]
  @limited [:revolute, :prismatic]

  @example_limits %{
    revolute:
      "`limit lower: ~u(-90 degree), upper: ~u(90 degree), effort: ~u(10 newton_meter), " <>
        "velocity: ~u(60 degree_per_second)`",
    prismatic:
      "`limit lower: ~u(0 meter), upper: ~u(0.5 meter), effort: ~u(10 newton), " <>
        "velocity: ~u(0.1 meter_per_second)`"
  }

  @doc "Checks a joint whose declaration ends."
  @spec check(Node.t()) :: :ok | {:error, String.t()}
  def check(%Node{kind: :joint} = joint) do
    checks = [
      &check_type/1,
      &check_child_link/1,
      &check_limit/1,
      &check_axis_of/1,
      &check_dynamics/1,
      &check_units/1,
      &check_order/1
    ]

    Enum.find_value(checks, :ok, fn check -> with(:ok <- check.(joint), do: nil) end)
  end

  @doc """
  Returns the entities of a joint whose units depend on its type, each with the words before its
  mistakes.
  """
  @spec measured(Node.t()) :: [{Node.t(), String.t()}]
  def measured(%Node{kind: :joint} = joint) do
    own = for node <- joint.nodes, node.kind in [:limit, :dynamics], do: {node, "#{node.kind}: "}

    transmissions =
      for component <- joint.nodes,
          component.kind in Grammar.components(),
          transmission <- Node.nodes(component, :transmission),
          do: {transmission, "#{Node.describe(component)}: transmission: "}

    own ++ transmissions
  end

  @doc "Checks an axis whose declaration ends."
  @spec check_axis(Node.t()) :: :ok | {:error, String.t()}
  def check_axis(%Node{kind: :axis, fields: fields}) do
    numbers = Map.take(fields, [:x, :y, :z])
    angles = Map.take(fields, [:roll, :pitch, :yaw])

    cond do
      numbers != %{} and angles != %{} ->
        {:error, "an axis has either x, y, z or roll, pitch, yaw; keep one of them"}

      numbers != %{} and Enum.all?(Map.values(numbers), &(&1 == 0)) ->
        {:error, "an axis needs a direction, got: x, y and z of zero; set one of them to 1"}

      true ->
        :ok
    end
  end

  defp check_type(%{fields: %{type: _}}), do: :ok

  defp check_type(joint) do
    {:error, "#{Node.describe(joint)} has no type; add `type` with one of #{types()}"}
  end

  defp types, do: Enum.map_join(Grammar.joint_types(), ", ", &inspect/1)

  defp check_child_link(joint) do
    if has?(joint, :link) do
      :ok
    else
      {:error,
       "All joints must connect to a child link: #{Node.describe(joint)} has no child link; " <>
         "add `link :name` inside it"}
    end
  end

  defp check_limit(%{fields: %{type: type}} = joint) do
    limit = Node.fields_of(joint, :limit)

    cond do
      type in @limited and limit == nil -> {:error, unlimited(joint, type)}
      type in @rigid and limit != nil -> {:error, limited(joint, type)}
      type in @unlimited and limit != nil -> check_endless(joint, Map.keys(limit))
      true -> :ok
    end
  end

  defp unlimited(joint, type) do
    """
    Limits must be present for #{type} joints: #{Node.describe(joint)} has none; add \
    #{@example_limits[type]} with its own numbers\
    """
  end

  defp limited(joint, type),
    do: "Limits cannot be set for #{type} joints: remove `limit` from #{Node.describe(joint)}"

  defp check_endless(joint, fields) do
    case Enum.filter([:lower, :upper], &(&1 in fields)) do
      [] ->
        :ok

      [field | _] ->
        {:error,
         "limit: #{field} cannot be set for #{joint.fields.type} joints, which have no end; " <>
           "remove it from #{Node.describe(joint)}"}
    end
  end

  defp check_axis_of(%{fields: %{type: type}} = joint) do
    cond do
      type == :planar and not has?(joint, :axis) -> {:error, no_normal(joint)}
      type in @rigid and has?(joint, :axis) -> {:error, needless_axis(joint, type)}
      true -> :ok
    end
  end

  defp no_normal(joint) do
    """
    An axis must be present for planar joints: #{Node.describe(joint)} has none; add `axis do \
    end` for a plane whose surface normal is z, or turn the surface normal by roll and pitch\
    """
  end

  defp needless_axis(joint, type) do
    remedy =
      if type == :floating,
        do: "remove it, or make the joint `:planar`, whose axis is the normal of its plane",
        else: "remove it, or give the joint a type that moves"

    "Cannot set an axis when parent joint is #{type}: #{Node.describe(joint)}; #{remedy}"
  end

  defp check_dynamics(%{fields: %{type: type}} = joint) do
    if type in @rigid and has?(joint, :dynamics) do
      {:error,
       "Joint dynamics cannot be provided for #{type} joints: remove `dynamics` from " <>
         Node.describe(joint)}
    else
      :ok
    end
  end

  defp check_units(%{fields: %{type: type}} = joint) do
    Enum.find_value(measured(joint), :ok, fn {node, words} ->
      Enum.find_value(Enum.sort(node.fields), fn {field, value} ->
        with :ok <- Quantities.check(field, value, type),
             do: nil,
             else: ({:error, reason} -> {:error, words <> reason})
      end)
    end)
  end

  defp check_order(joint) do
    case Node.fields_of(joint, :limit) do
      %{lower: %Unit{} = lower, upper: %Unit{} = upper} -> check_order(lower, upper)
      _ -> :ok
    end
  end

  defp check_order(lower, upper) do
    if Unit.compare(lower, upper) == :gt do
      {:error,
       "limit: lower #{Unit.to_string!(lower)} is above upper #{Unit.to_string!(upper)}; " <>
         "swap them"}
    else
      :ok
    end
  end

  defp has?(joint, kind), do: Node.nodes(joint, kind) != []
end

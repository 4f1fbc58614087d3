defmodule BB.Robot.Topology do
  @moduledoc """
  The tree of a robot's links and joints: its order, and the way from the root to each part.
  `BB.Robot` has the topology of a robot. Pure.

      iex> topology = BB.Robot.Topology.new([{:base, [{:shoulder, {:arm, []}}]}])
      iex> BB.Robot.Topology.path_to(topology, :arm)
      {:ok, [:base, :shoulder, :arm]}
      iex> BB.Robot.Topology.depth_of(topology, :arm)
      {:ok, 1}

    * `:link_order`, `:joint_order` - the names, depth first: parents before children, siblings
      in the order of the declaration
    * `:paths` - by the name of each link and joint, the names from the root link to it
    * `:depth` - by name: the root link 0, its joints and their links 1, the next ones 2
  """

  alias BB.Error.Kinematics.{NotAnAncestor, UnknownLink}

  defstruct link_order: [], joint_order: [], paths: %{}, depth: %{}

  @typedoc "A link with its joints, each with its child link."
  @type tree :: {atom(), [{atom(), tree()}]}

  @type t :: %__MODULE__{
          link_order: [atom()],
          joint_order: [atom()],
          paths: %{atom() => [atom()]},
          depth: %{atom() => non_neg_integer()}
        }

  @doc "Makes the topology of the trees of the root links: none or one."
  @spec new([tree()]) :: t()
  def new(trees) do
    topology = Enum.reduce(trees, %__MODULE__{}, &add_link(&2, &1, []))

    %{
      topology
      | link_order: Enum.reverse(topology.link_order),
        joint_order: Enum.reverse(topology.joint_order),
        depth: Map.new(topology.paths, fn {name, path} -> {name, div(length(path), 2)} end)
    }
  end

  defp add_link(topology, {name, joints}, above) do
    path = above ++ [name]

    topology
    |> put_path(name, path)
    |> Map.update!(:link_order, &[name | &1])
    |> then(&Enum.reduce(joints, &1, fn joint, topology -> add_joint(topology, joint, path) end))
  end

  defp add_joint(topology, {name, link}, above) do
    path = above ++ [name]

    topology
    |> put_path(name, path)
    |> Map.update!(:joint_order, &[name | &1])
    |> add_link(link, path)
  end

  defp put_path(topology, name, path),
    do: %{topology | paths: Map.put(topology.paths, name, path)}

  @doc """
  Returns the depth of a link or joint: `{:ok, depth}`, or an error for an unknown name.
  """
  @spec depth_of(t(), atom()) :: {:ok, non_neg_integer()} | {:error, Exception.t()}
  def depth_of(%__MODULE__{depth: depth}, name) do
    with :error <- Map.fetch(depth, name), do: {:error, %UnknownLink{link: name}}
  end

  @doc """
  Returns the names from the root link to a link or joint: `{:ok, names}`, or an error for an
  unknown name.
  """
  @spec path_to(t(), atom()) :: {:ok, [atom()]} | {:error, Exception.t()}
  def path_to(%__MODULE__{paths: paths}, name) do
    with :error <- Map.fetch(paths, name), do: {:error, %UnknownLink{link: name}}
  end

  @doc """
  Returns the names from a link or joint down to another: `{:ok, [source, …, target]}`.

  The error is a `BB.Error.Kinematics.NotAnAncestor` where the first does not carry the second.
  """
  @spec path_between(t(), atom(), atom()) :: {:ok, [atom()]} | {:error, Exception.t()}
  def path_between(%__MODULE__{} = topology, source, target) do
    with {:ok, above} <- path_of(topology, source, :source),
         {:ok, path} <- path_of(topology, target, :target) do
      if List.starts_with?(path, above),
        do: {:ok, Enum.drop(path, length(above) - 1)},
        else: {:error, not_an_ancestor(topology, source, target)}
    end
  end

  defp path_of(topology, name, role) do
    with {:error, error} <- path_to(topology, name), do: {:error, %{error | role: role}}
  end

  defp not_an_ancestor(topology, source, target) do
    shared = common_path(topology.paths[source], topology.paths[target])

    %NotAnAncestor{
      source_link: source,
      target_link: target,
      common_ancestor: shared |> Enum.filter(&(&1 in topology.link_order)) |> List.last()
    }
  end

  @doc """
  Returns what two paths from the root have in common.

      iex> BB.Robot.Topology.common_path([:base, :left, :arm], [:base, :right])
      [:base]
  """
  @spec common_path([atom()], [atom()]) :: [atom()]
  def common_path([name | a], [name | b]), do: [name | common_path(a, b)]
  def common_path(_a, _b), do: []

  @doc "Returns the names of the links without joints, in order."
  @spec leaf_links(t(), BB.Robot.t()) :: [atom()]
  def leaf_links(%__MODULE__{link_order: order}, %{links: links}),
    do: Enum.filter(order, &(Map.fetch!(links, &1).child_joints == []))

  @doc "Returns the greatest depth, 0 for a robot without joints."
  @spec max_depth(t()) :: non_neg_integer()
  def max_depth(%__MODULE__{depth: depth}), do: depth |> Map.values() |> Enum.max(fn -> 0 end)
end

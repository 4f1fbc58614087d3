defmodule BB.Dsl.Node do
  @moduledoc """
  One entity of a robot's declaration: its kind, name, fields and the entities inside it.
  `BB.Dsl.Builder` makes the tree of nodes, `BB.Dsl.Rules` and `BB.Dsl.Compiler` read it.

  `parent` is the kind of the entity around it.
  """
  @moduledoc no_example: "internal: the words of BB.Dsl make nodes"

  @type place :: %{file: String.t(), line: non_neg_integer()}

  @typedoc "A name: a string for a simulated bus, an address for an I2C device, else an atom."
  @type name :: atom() | String.t() | non_neg_integer()

  @type t :: %__MODULE__{
          kind: atom(),
          name: name(),
          child: term(),
          path: [name()],
          parent: atom(),
          place: place(),
          fields: %{atom() => term()},
          nodes: [t()]
        }

  @enforce_keys [:kind, :path, :place]
  defstruct [:kind, :name, :child, :path, :parent, :place, fields: %{}, nodes: []]

  @doc "Returns the entities of `kind` inside a node, in the order of the declaration."
  @spec nodes(t(), atom()) :: [t()]
  def nodes(%__MODULE__{nodes: nodes}, kind), do: Enum.filter(nodes, &(&1.kind == kind))

  @doc "Returns the fields of the only entity of `kind` inside a node, `nil` when it has none."
  @spec fields_of(t(), atom()) :: %{atom() => term()} | nil
  def fields_of(%__MODULE__{} = node, kind) do
    with [%{fields: fields} | _] <- nodes(node, kind), do: fields, else: ([] -> nil)
  end

  @doc "Returns the entities of `kind` in all sections of a robot, such as the `:sensors`."
  @spec in_sections(t(), atom(), atom()) :: [t()]
  def in_sections(%__MODULE__{kind: :robot} = robot, section, kind),
    do: for(node <- nodes(robot, section), inner <- nodes(node, kind), do: inner)

  @doc "Returns the fields of all sections of a kind, which add up."
  @spec section_fields(t(), atom()) :: %{atom() => term()}
  def section_fields(%__MODULE__{kind: :robot} = robot, section),
    do: robot |> nodes(section) |> Enum.reduce(%{}, &Map.merge(&2, &1.fields))

  @doc "Returns a node and all nodes inside it."
  @spec all(t()) :: [t()]
  def all(%__MODULE__{nodes: nodes} = node), do: [node | Enum.flat_map(nodes, &all/1)]

  @doc "Describes an entity in an error message, by its kind and name."
  @spec describe(t()) :: String.t()
  def describe(%__MODULE__{kind: :device, name: address}) when is_integer(address),
    do: "the simulated device at 0x" <> Integer.to_string(address, 16)

  def describe(%__MODULE__{kind: :device, name: name}),
    do: "the simulated device #{inspect(name)}"

  def describe(%__MODULE__{kind: kind, name: name}) when kind in [:i2c, :gpio],
    do: "the simulated #{name}"

  def describe(%__MODULE__{kind: kind, name: nil}), do: "#{kind}"
  def describe(%__MODULE__{kind: kind, name: name}), do: "#{kind} #{inspect(name)}"
end

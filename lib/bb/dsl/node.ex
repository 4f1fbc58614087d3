defmodule BB.Dsl.Node do
  @moduledoc """
  One entity of a robot's declaration: its kind, name, fields and the entities inside it.
  `BB.Dsl.Builder` makes the tree of nodes, `BB.Dsl.Rules` and `BB.Dsl.Compiler` read it.
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
          place: place(),
          fields: %{atom() => term()},
          nodes: [t()]
        }

  @enforce_keys [:kind, :path, :place]
  defstruct [:kind, :name, :child, :path, :place, fields: %{}, nodes: []]

  @doc "Returns the entities of `kind` inside a node, in the order of the declaration."
  @spec nodes(t(), atom()) :: [t()]
  def nodes(%__MODULE__{nodes: nodes}, kind), do: Enum.filter(nodes, &(&1.kind == kind))

  @doc "Returns the fields of the only entity of `kind` inside a node, `nil` when it has none."
  @spec fields_of(t(), atom()) :: %{atom() => term()} | nil
  def fields_of(%__MODULE__{} = node, kind) do
    with [%{fields: fields} | _] <- nodes(node, kind), do: fields, else: ([] -> nil)
  end

  @doc "Describes a simulated bus or device in an error message."
  @spec describe(t()) :: String.t()
  def describe(%__MODULE__{kind: :device, name: address}) when is_integer(address),
    do: "the simulated device at 0x" <> Integer.to_string(address, 16)

  def describe(%__MODULE__{kind: :device, name: name}),
    do: "the simulated device #{inspect(name)}"

  def describe(%__MODULE__{name: name}), do: "the simulated #{name}"
end

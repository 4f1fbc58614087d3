defmodule BB.Dsl.Node do
  @moduledoc """
  One entity of a robot's declaration, as it was written: its kind, name, fields and the entities inside it.
  """

  @type place :: %{file: String.t(), line: non_neg_integer()}

  @typedoc "A name; of a simulated bus it is text, of a device on it an address."
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

  @doc "The entities of `kind` inside it, in the order of the declaration."
  @spec nodes(t(), atom()) :: [t()]
  def nodes(%__MODULE__{nodes: nodes}, kind), do: Enum.filter(nodes, &(&1.kind == kind))

  @doc "The fields of its only entity of `kind`, `nil` when it has none."
  @spec fields_of(t(), atom()) :: %{atom() => term()} | nil
  def fields_of(%__MODULE__{} = node, kind) do
    with [%{fields: fields} | _] <- nodes(node, kind), do: fields, else: ([] -> nil)
  end
end

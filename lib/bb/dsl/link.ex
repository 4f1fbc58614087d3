defmodule BB.Dsl.Link do
  @moduledoc "The word for a joint, inside a link."

  import BB.Dsl.Vocabulary, only: [entity: 5]

  @inside [BB.Dsl.Component, BB.Dsl.Topology, BB.Dsl.Joint]

  @doc """
  Declares a joint, which connects the link it stands in with the link that stands in it.

  Inside, or as keywords: `type` (`:revolute`, `:continuous`, `:prismatic` or `:fixed`), `origin`, `axis`, `limit`,
  `dynamics`; inside only: its sensors and its child link. Without a name it is `:joint_0`, `:joint_1`, …
  """
  defmacro joint(name_or_block), do: entity(:joint, [name_or_block], 1, @inside, __CALLER__)
  defmacro joint(name, block), do: entity(:joint, [name, block], 1, @inside, __CALLER__)

  defmacro joint(name, fields, block),
    do: entity(:joint, [name, fields, block], 1, @inside, __CALLER__)
end

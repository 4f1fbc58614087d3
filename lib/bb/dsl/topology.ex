defmodule BB.Dsl.Topology do
  @moduledoc "The word for a link, in `topology` and inside a joint."

  import BB.Dsl.Vocabulary, only: [entity: 5]

  @inside [BB.Dsl.Component, BB.Dsl.Link]

  @doc """
  Declares a link, a rigid part of the robot: `link :base_link do … end`, or `link :arm` when nothing is on it.

  Without a name it is `:link_0`, `:link_1`, …
  """
  defmacro link, do: entity(:link, [], 1, @inside, __CALLER__)
  defmacro link(name_or_block), do: entity(:link, [name_or_block], 1, @inside, __CALLER__)
  defmacro link(name, block), do: entity(:link, [name, block], 1, @inside, __CALLER__)
end

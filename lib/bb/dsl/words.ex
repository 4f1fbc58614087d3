defmodule BB.Dsl.Words do
  @moduledoc """
  The words inside the blocks of a robot's declaration, in one module for each kind of block:
  `BB.Dsl.Words.Link` has the words inside `link`. `BB.Dsl.Grammar` lists them.

  A block imports its words for itself alone, so that no word clashes with a function of the
  robot's module. `BB.Dsl.Robot` has the words outside of all blocks.

      iex> BB.Dsl.Words.module(:link)
      BB.Dsl.Words.Link
      iex> Keyword.take(BB.Dsl.Words.Origin.__info__(:macros), [:yaw])
      [yaw: 1]
  """

  alias BB.Dsl.{Block, Grammar}

  @doc "Returns the module with the words inside an entity of `kind`."
  @spec module(atom()) :: module()
  defdelegate module(kind), to: Block, as: :words

  for kind <- Grammar.kinds(), kind != :robot do
    defmodule Block.words(kind) do
      @moduledoc "The words inside `#{kind}`."
      @moduledoc no_example: "BB.Dsl has an example of the whole language"

      use BB.Dsl.Vocabulary, kind: kind
    end
  end
end

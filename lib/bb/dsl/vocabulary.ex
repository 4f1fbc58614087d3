defmodule BB.Dsl.Vocabulary do
  @moduledoc """
  Makes the words of the DSL: macros that record the declaration of a robot's module.

  `use BB.Dsl.Vocabulary, kind: :link` defines the words that may stand inside a `link`, as
  `BB.Dsl.Grammar` lists them: a macro for each field, and macros for each entity.

      defmodule InsideALink do
        @moduledoc "The words inside `link`."
        use BB.Dsl.Vocabulary, kind: :link
      end

  A block imports the words for its inside, so that they cannot clash with functions of the
  robot's module. The arguments of a word are evaluated in the body of the robot's module: they
  may be any expressions, and entities may stand in comprehensions.
  """

  alias BB.Dsl.{Block, Functions, Grammar}

  defmacro __using__(kind: kind) do
    quote bind_quoted: [kind: kind] do
      for field <- BB.Dsl.Grammar.field_words(kind) do
        @doc "Sets the field `#{field}` of the entity around it."
        defmacro unquote(field)(value),
          do: BB.Dsl.Vocabulary.field(unquote(field), value, __CALLER__)
      end

      for entity <- BB.Dsl.Grammar.entities(kind), arity <- BB.Dsl.Grammar.arities(entity) do
        arguments = Macro.generate_arguments(arity, __MODULE__)
        @doc BB.Dsl.Glossary.text(entity)
        defmacro unquote(entity)(unquote_splicing(arguments)),
          do: BB.Dsl.Vocabulary.entity(unquote(entity), unquote(arguments), __CALLER__)
      end
    end
  end

  @doc "Returns the code that sets a field of the entity around it."
  @spec field(atom(), Macro.t(), Macro.Env.t()) :: Macro.t()
  def field(name, value, caller) do
    quote do
      BB.Dsl.Builder.set(
        __MODULE__,
        unquote(name),
        unquote(value),
        unquote(Block.place(caller))
      )
    end
  end

  @doc """
  Returns the code of an entity of `kind`.

  `args` are the arguments of the entity's macro: at most its plain arguments
  (`BB.Dsl.Grammar.arguments/1`), then fields as keywords, a block, or both.
  """
  @spec entity(atom(), [Macro.t()], Macro.Env.t()) :: Macro.t()
  def entity(kind, args, caller) do
    {block, args} = take_block(args)
    {fields, plain} = take_fields(args, length(Grammar.arguments(kind)))
    {plain, definitions} = Functions.lift(plain, caller)

    quote do
      unquote_splicing(definitions)

      BB.Dsl.Builder.open(
        __MODULE__,
        unquote(kind),
        unquote(plain),
        unquote(fields),
        unquote(Block.place(caller))
      )

      unquote(Block.code(kind, block, caller))
      BB.Dsl.Builder.close(__MODULE__)
    end
  end

  defp take_block(args) do
    last = List.last(args)

    if keywords?(last) and Keyword.has_key?(last, :do) do
      {block, rest} = Keyword.pop(last, :do)
      above = List.delete_at(args, -1)
      {block, if(rest == [], do: above, else: above ++ [rest])}
    else
      {nil, args}
    end
  end

  defp take_fields(args, positions) do
    last = List.last(args)

    if length(args) > positions or keywords?(last),
      do: {last || [], List.delete_at(args, -1)},
      else: {[], args}
  end

  defp keywords?(list), do: list != [] and Keyword.keyword?(list)
end

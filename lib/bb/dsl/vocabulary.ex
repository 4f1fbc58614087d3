defmodule BB.Dsl.Vocabulary do
  @moduledoc """
  Makes the words of the DSL: macros that record the declaration of a robot's module.

  The modules with words use it (`BB.Dsl.Words`). With `fields:` it defines a macro for each
  field; a word that declares an entity is a macro which calls `entity/5`.

      defmodule Gripper do
        use BB.Dsl.Vocabulary, fields: [:force]

        @doc "Declares a finger of the gripper."
        defmacro finger(name), do: entity(:finger, [name], 1, [], __CALLER__)
      end

  A block imports the words for its inside, so that they cannot clash with functions of the
  robot's module. The arguments of a word are evaluated in the body of the robot's module: they
  may be any expressions, and entities may stand in comprehensions.
  """

  defmacro __using__(opts) do
    quote bind_quoted: [fields: opts[:fields] || []] do
      import BB.Dsl.Vocabulary, only: [entity: 5], warn: false

      for field <- fields do
        @doc "Sets the field `#{field}` of the entity around it."
        defmacro unquote(field)(value),
          do: BB.Dsl.Vocabulary.field(unquote(field), value, __CALLER__)
      end
    end
  end

  @doc """
  Defines a module with the words of a block that has fields alone.

  `block` names the block in the documentation of the module.
  """
  defmacro words(module, block, fields) do
    quote do
      defmodule unquote(module) do
        @moduledoc "The words inside #{unquote(block)}, each of which sets a field."
        @moduledoc no_example: "BB.Dsl has an example of the whole language"

        use BB.Dsl.Vocabulary, fields: unquote(fields)
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
        unquote(Macro.escape(place(caller)))
      )
    end
  end

  @doc """
  Returns the code of an entity of `kind`.

  `args` are the arguments of the entity's macro: at most `positions` plain arguments, then fields
  as keywords, a block, or both. The block imports the words of the modules `vocabulary`.
  """
  @spec entity(atom(), [Macro.t()], non_neg_integer(), [module()], Macro.Env.t()) :: Macro.t()
  def entity(kind, args, positions, vocabulary, caller) do
    {block, args} = take_block(args)
    {fields, plain} = take_fields(args, positions)

    quote do
      BB.Dsl.Builder.open(
        __MODULE__,
        unquote(kind),
        unquote(plain),
        unquote(fields),
        unquote(Macro.escape(place(caller)))
      )

      unquote(with_words(block, vocabulary))
      BB.Dsl.Builder.close(__MODULE__)
    end
  end

  defp take_block(args) do
    case List.last(args) do
      [_ | _] = last -> take_block(args, last, Keyword.keyword?(last) && last[:do])
      _ -> {nil, args}
    end
  end

  defp take_block(args, _last, nothing) when nothing in [nil, false], do: {nil, args}

  defp take_block(args, last, block) do
    args = List.delete_at(args, -1)
    rest = Keyword.delete(last, :do)
    {block, if(rest == [], do: args, else: args ++ [rest])}
  end

  defp take_fields(args, positions) do
    case {List.last(args), length(args)} do
      {fields, count} when count > positions or is_list(fields) ->
        {fields || [], List.delete_at(args, -1)}

      _ ->
        {[], args}
    end
  end

  # The imports hold in the clause of the `case` alone.
  defp with_words(nil, _vocabulary), do: nil

  defp with_words(block, vocabulary) do
    imports = Enum.map(vocabulary, &import_words/1)

    quote do
      case :ok do
        :ok ->
          unquote_splicing(imports)
          unquote(block)
      end
    end
  end

  defp import_words(BB.Unit), do: quote(do: import(BB.Unit, only: :sigils, warn: false))

  defp import_words(BB.Parameter.Reference),
    do: quote(do: import(BB.Parameter.Reference, only: [param: 1], warn: false))

  defp import_words(module), do: quote(do: import(unquote(module), warn: false))

  defp place(caller), do: %{file: caller.file, line: caller.line}
end

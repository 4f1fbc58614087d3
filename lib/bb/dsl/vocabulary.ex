defmodule BB.Dsl.Vocabulary do
  @moduledoc """
  Makes the words of the DSL: macros that write down what a robot's module declares.

  The words for the inside of an entity are imported in its block only, so that they cannot clash with functions of the
  robot's module:

      defmodule BB.Dsl.Axis do
        use BB.Dsl.Vocabulary, fields: [:x, :y, :z]
      end

  An entity's arguments are evaluated in the body of the robot's module, so they may be any expressions, and entities may
  stand in comprehensions.
  """

  defmacro __using__(opts) do
    for field <- Keyword.fetch!(opts, :fields) do
      quote do
        @doc "Sets the field `#{unquote(field)}` of the entity that it stands in."
        defmacro unquote(field)(value),
          do: BB.Dsl.Vocabulary.field(unquote(field), value, __CALLER__)
      end
    end
  end

  @doc "The code that sets a field of the entity it stands in."
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
  The code of an entity of `kind`. `args` is what its macro was given: at most `positions` plain arguments, then fields as
  keywords, a block, or both. In the block the words of the modules `vocabulary` are known.
  """
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

      unquote(inside(block, vocabulary))
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

  # A clause keeps the imports to the block.
  defp inside(nil, _vocabulary), do: nil

  defp inside(block, vocabulary) do
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

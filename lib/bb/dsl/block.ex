defmodule BB.Dsl.Block do
  @moduledoc """
  Makes the code of a block in a robot's declaration: it imports the words of the block, and
  refuses each call that is neither a word of the block nor defined anywhere else.

  Without the refusal a misspelt word would be an undefined function, which says neither in which
  robot it stands nor which words may stand there. Expressions that are no calls, and calls of
  macros and of imported functions, are left alone.
  """
  @moduledoc no_example: "internal: BB.Dsl.Vocabulary uses it in macros"

  alias BB.Dsl.Grammar

  # Modules whose functions stand in values, in each block but those that declare parameters.
  @sigils quote(do: import(BB.Unit, only: [sigil_u: 2], warn: false))
  @param quote(do: import(BB.Parameter.Reference, only: [param: 1], warn: false))
  @action Module.concat(["BB", "Controller", "Action"])
  @no_param quote(do: import(BB.Parameter.Reference, only: [], warn: false))

  @doc "Returns the code of a place in the source."
  @spec place(Macro.Env.t()) :: Macro.t()
  def place(caller), do: Macro.escape(%{file: caller.file, line: caller.line})

  @doc "Returns the code of a block inside an entity of `kind`."
  @spec code(atom(), Macro.t(), Macro.Env.t()) :: Macro.t()
  def code(_kind, nil, _caller), do: nil

  # The imports hold in the clause of the `case` alone.
  def code(kind, block, caller) do
    quote do
      case :ok do
        :ok ->
          unquote_splicing(outer_words(caller))
          import unquote(BB.Dsl.Words.module(kind)), warn: false
          unquote_splicing(values(kind))
          unquote(statements(block, kind, caller, variables(block)))
      end
    end
  end

  # The words of the block around this one do not hold inside it.
  defp outer_words(caller) do
    for {module, _macros} <- caller.macros,
        BB.Dsl.Words.module?(module),
        do: quote(do: import(unquote(module), only: [], warn: false))
  end

  defp values(kind) when kind in [:parameters, :group, :param], do: [@sigils, @no_param]
  defp values(kind) when kind in [:controllers], do: [@sigils, @param | actions()]
  defp values(_kind), do: [@sigils, @param]

  # `command(:stop)` and `handle_event(fun)` are values of the ready-made controllers.
  defp actions do
    if Code.ensure_loaded?(@action),
      do: [quote(do: import(unquote(@action), warn: false))],
      else: []
  end

  defp statements({:__block__, meta, statements}, kind, caller, known),
    do: {:__block__, meta, Enum.map(statements, &statements(&1, kind, caller, known))}

  defp statements({name, meta, context} = variable, kind, caller, known)
       when is_atom(name) and is_atom(context) do
    cond do
      name in known or Macro.Env.has_var?(caller, {name, context}) -> variable
      zero_arguments?(name, kind) -> {name, meta, []}
      String.starts_with?("#{name}", "_") -> variable
      true -> refusal(name, meta, caller)
    end
  end

  defp statements({name, meta, args} = call, kind, caller, known)
       when is_atom(name) and is_list(args) do
    cond do
      word?(name, length(args), kind) -> call
      name in Grammar.words(kind) -> refusal(name, meta, caller)
      defined?(name, length(args), caller) -> {name, meta, bodies(args, kind, caller, known)}
      true -> refusal(name, meta, caller)
    end
  end

  defp statements(other, _kind, _caller, _known), do: other

  # The statements of `for … do`, `if … do … else …`, `case … do … -> …` and the like.
  defp bodies(args, kind, caller, known) do
    case List.pop_at(args, -1) do
      {[{:do, _} | _] = blocks, above} ->
        above ++ [for({key, body} <- blocks, do: {key, body(body, kind, caller, known)})]

      _no_block ->
        args
    end
  end

  defp body([{:->, _, _} | _] = clauses, kind, caller, known) do
    for {:->, meta, [head, body]} <- clauses,
        do: {:->, meta, [head, statements(body, kind, caller, known)]}
  end

  defp body(body, kind, caller, known), do: statements(body, kind, caller, known)

  # A variable is bound by a pattern, which is more than a statement.
  defp variables(block) do
    {_block, found} = Macro.prewalk(block, [], &collect_variable/2)
    found -- Enum.uniq(bare_statements(block))
  end

  defp collect_variable({name, _meta, context} = variable, found)
       when is_atom(name) and is_atom(context),
       do: {variable, [name | found]}

  defp collect_variable(other, found), do: {other, found}

  defp bare_statements({:__block__, _meta, statements}),
    do: Enum.flat_map(statements, &bare_statements/1)

  defp bare_statements({name, _meta, context}) when is_atom(name) and is_atom(context), do: [name]
  defp bare_statements(_statement), do: []

  defp zero_arguments?(name, kind),
    do: name in Grammar.entities(kind) and 0 in Grammar.arities(name)

  defp word?(name, arity, kind) do
    (name in Grammar.field_words(kind) and arity == 1) or
      (name in Grammar.entities(kind) and arity in Grammar.arities(name))
  end

  defp defined?(name, arity, caller) do
    Macro.special_form?(name, arity) or Macro.operator?(name, arity) or
      Module.defines?(caller.module, {name, arity}) or
      Enum.any?(Macro.Env.lookup_import(caller, {name, arity}), fn {_kind, module} ->
        not BB.Dsl.Words.module?(module)
      end)
  end

  defp refusal(name, meta, caller) do
    place = place(%{caller | line: Keyword.get(meta, :line, caller.line)})
    quote(do: BB.Dsl.Builder.refuse(__MODULE__, unquote(name), unquote(place)))
  end
end

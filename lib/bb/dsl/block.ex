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

  # What stands in values: ~u, param/1 (not where `param` is an entity), and in `controllers` the
  # actions of the ready-made ones.
  @units {BB.Unit, [sigil_u: 2]}
  @references {BB.Parameter.Reference, [param: 1]}
  @reference_modules [BB.Parameter.Reference, BB.Dsl.ParamRef]
  @actions {Module.concat(["BB", "Controller", "Action"]),
            [command: 1, command: 2, handle_event: 1]}

  # These modules are made by macros that use this one.
  @words Module.concat(["BB", "Dsl", "Words"])
  @sections Module.concat(["BB", "Dsl", "Robot"])

  @doc "Returns the code of a place in the source."
  @spec place(Macro.Env.t()) :: Macro.t()
  def place(caller), do: Macro.escape(%{file: caller.file, line: caller.line})

  @doc "Returns the module with the words inside an entity of `kind`."
  @spec words(atom()) :: module()
  def words(:robot), do: @sections
  def words(kind), do: Module.concat(@words, Macro.camelize("#{kind}"))

  defp words?(module), do: module in Enum.map(Grammar.kinds(), &words/1)

  @doc "Returns the code of a block inside an entity of `kind`."
  @spec code(atom(), Macro.t(), Macro.Env.t()) :: Macro.t()
  def code(_kind, nil, _caller), do: nil

  # The imports hold in the clause of the `case` alone.
  def code(kind, block, caller) do
    quote do
      case :ok do
        :ok ->
          unquote_splicing(outer_words(caller))
          import unquote(words(kind)), warn: false
          unquote_splicing(values(kind, caller))
          unquote(statements(block, kind, caller, variables(block)))
      end
    end
  end

  # The words of the block around this one do not hold inside it.
  defp outer_words(caller) do
    for {module, _macros} <- caller.macros,
        words?(module),
        do: quote(do: import(unquote(module), only: [], warn: false))
  end

  # There `param` and `command` are words.
  defp values(kind, caller) when kind in [:parameters, :group, :param],
    do: hide(@reference_modules, caller) ++ used([@units], caller)

  defp values(:commands, caller),
    do: hide([elem(@actions, 0)], caller) ++ used([@units, @references], caller)

  defp values(:controllers, caller), do: used([@units, @references, @actions], caller)
  defp values(_kind, caller), do: used([@units, @references], caller)

  defp hide(modules, caller) do
    for module <- modules,
        imports?(module, caller),
        do: quote(do: import(unquote(module), only: [], warn: false))
  end

  # A module that the robot's module imports itself is left as it is.
  defp used(imports, caller) do
    for {module, names} <- imports,
        Code.ensure_loaded?(module),
        not imported?(module, caller),
        do: quote(do: import(unquote(module), only: unquote(names), warn: false))
  end

  # Either module of references will do.
  defp imported?(module, caller) when module in @reference_modules,
    do: Enum.any?(@reference_modules, &imports?(&1, caller))

  defp imported?(module, caller), do: imports?(module, caller)

  defp imports?(module, caller),
    do: Enum.any?(caller.functions ++ caller.macros, &match?({^module, [_ | _]}, &1))

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
        not words?(module)
      end)
  end

  defp refusal(name, meta, caller) do
    place = place(%{caller | line: Keyword.get(meta, :line, caller.line)})
    quote(do: BB.Dsl.Builder.refuse(__MODULE__, unquote(name), unquote(place)))
  end
end

defmodule BB.Message.Compiler do
  @moduledoc false
  # Makes a payload's constructor from its schema: a function with an argument for each field, which takes the attributes one
  # by one and then tests them all in one expression. What it cannot take or refuses goes to BB.Options, which has the last
  # word and the words of the error.

  alias BB.Options

  @unset :"$unset"

  @doc "The checked schema of `use BB.Message, schema: …`; anything wrong is a CompileError."
  def schema!(opts, env) do
    schema =
      case opts do
        [schema: schema] -> Options.new!(schema)
        _ -> fail(env, "use BB.Message takes schema: and nothing else, got: #{inspect(opts)}")
      end

    unless Module.defines?(env.module, {:__struct__, 0}) do
      fail(env, "use BB.Message comes after defstruct, and #{inspect(env.module)} has none yet")
    end

    schema
  end

  def payload?(module), do: function_exported?(module, :__payload__, 1)

  defmacro __before_compile__(env) do
    schema = Module.get_attribute(env.module, :bb_message_schema)
    refuse_unknown_fields(schema, struct_fields(env), env)
    {fields, helpers} = schema.schema |> Enum.map(&field/1) |> Enum.unzip()

    quote generated: true do
      @doc "The schema of the payload."
      @spec schema() :: BB.Options.t()
      def schema, do: @bb_message_schema

      unquote(unless Module.defines?(env.module, {:new, 2}), do: constructor())

      @doc false
      def __payload__(attrs) when is_map(attrs) and not is_struct(attrs),
        do: __payload__(Enum.sort(attrs))

      def __payload__(attrs) do
        case bb_take(attrs, unquote_splicing(Enum.map(fields, fn _ -> @unset end))) do
          :refused -> BB.Message.Compiler.validate(__MODULE__, attrs)
          payload -> {:ok, payload}
        end
      end

      unquote_splicing(Enum.map(fields, &taking_clause(&1, fields)))
      unquote(final_clause(fields))

      defp bb_take(_attrs, unquote_splicing(Enum.map(fields, fn _ -> Macro.var(:_, nil) end))),
        do: :refused

      unquote_splicing(List.flatten(helpers))
    end
  end

  defp constructor do
    quote do
      @doc """
      A message with this payload: `{:ok, message}` or `{:error, %BB.Options.ValidationError{}}`.

      #{BB.Options.docs(@bb_message_schema)}
      """
      @spec new(atom(), BB.Message.attrs()) ::
              {:ok, BB.Message.t()} | {:error, BB.Options.ValidationError.t()}
      def new(frame_id, attrs) do
        case __payload__(attrs) do
          {:ok, payload} -> {:ok, BB.Message.wrap(payload, frame_id)}
          error -> error
        end
      end
    end
  end

  @doc "The way through BB.Options, for what the compiled constructor does not take."
  def validate(module, attrs) do
    with {:ok, attrs} <- Options.validate(attrs, module.schema()),
         do: {:ok, struct!(module, attrs)}
  end

  @doc false
  def cast_nested(key, spec, value) do
    with {:ok, [{^key, value}]} <-
           Options.validate([{key, value}], %Options{schema: [{key, spec}]}),
         do: {:ok, value}
  end

  defp fail(env, text), do: raise(CompileError, file: env.file, line: env.line, description: text)

  # Macro.struct!/2 left its place to Macro.struct_info!/2 in Elixir 1.18.
  defp struct_fields(env) do
    if function_exported?(Macro, :struct_info!, 2),
      do: Macro |> apply(:struct_info!, [env.module, env]) |> Enum.map(& &1.field),
      else: Macro |> apply(:struct!, [env.module, env]) |> Map.delete(:__struct__) |> Map.keys()
  end

  defp refuse_unknown_fields(schema, fields, env) do
    case Keyword.keys(schema.schema) -- fields do
      [] ->
        :ok

      keys ->
        fail(
          env,
          "the schema has #{inspect(keys)}, which the struct of #{inspect(env.module)} has not; its fields are #{inspect(fields)}"
        )
    end
  end

  # What is known of one field: its argument, the test that its value must pass, how the value is changed, and the value itself.
  defp field({key, spec}) do
    var = Macro.var(key, __MODULE__.Field)
    {test, helpers} = test_or_cast(key, spec, var)
    {Map.merge(%{key: key, var: var}, finish(key, spec, var, test)), helpers}
  end

  defp test_or_cast(key, spec, var) do
    cond do
      spec[:keys] ->
        {{:cast,
          quote(
            do:
              BB.Message.Compiler.cast_nested(
                unquote(key),
                unquote(Macro.escape(spec)),
                unquote(var)
              )
          )}, []}

      test = test(spec[:type], var, [:bb_all, key]) ->
        {expression, helpers} = test
        {{:test, expression}, helpers}

      true ->
        {{:cast, cast(spec[:type], var, key)}, []}
    end
  end

  defp cast({:custom, module, function, args}, var, _key) do
    quote do:
            unquote(module).unquote(function)(unquote(var), unquote_splicing(Macro.escape(args)))
  end

  defp cast(type, var, key) do
    quote do: BB.Options.Type.cast(unquote(Macro.escape(type)), unquote(var), unquote(key))
  end

  defp finish(key, spec, var, check) do
    required? = spec[:required]
    default = Keyword.fetch(spec, :default)

    prepare =
      case default do
        {:ok, value} when not required? -> or_default(var, Macro.escape(value))
        _ -> nil
      end

    value =
      if required? || default != :error,
        do: var,
        else: or_default(var, quote(do: blank.unquote(key)))

    %{prepare: prepare, value: value, check: allow_unset(check, var, required?, default)}
  end

  defp or_default(var, default) do
    quote generated: true do
      case unquote(var) do
        unquote(@unset) -> unquote(default)
        value -> value
      end
    end
  end

  defp allow_unset({:test, true}, _var, false, _default), do: {:test, true}

  defp allow_unset({:test, test}, var, true, _default),
    do: {:test, quote(do: unquote(var) !== unquote(@unset) and unquote(test))}

  defp allow_unset({:test, test}, var, _required?, :error),
    do: {:test, quote(do: unquote(var) === unquote(@unset) or unquote(test))}

  defp allow_unset({:cast, cast}, var, true, _default),
    do: {:cast, quote(do: if(unquote(var) === unquote(@unset), do: :error, else: unquote(cast)))}

  defp allow_unset({:cast, cast}, var, _required?, :error),
    do:
      {:cast,
       quote(
         do: if(unquote(var) === unquote(@unset), do: {:ok, unquote(@unset)}, else: unquote(cast))
       )}

  defp allow_unset(check, _var, _required?, _default), do: check

  # The first value of a key counts, and is there when its argument is set: a second one is left to BB.Options.
  defp taking_clause(%{key: key}, fields) do
    rest = Macro.var(:rest, __MODULE__)
    value = Macro.var(:value, __MODULE__)
    taken = Enum.map(fields, &if(&1.key == key, do: value, else: &1.var))
    before = Enum.map(fields, &if(&1.key == key, do: @unset, else: &1.var))

    quote generated: true do
      defp bb_take([{unquote(key), unquote(value)} | unquote(rest)], unquote_splicing(before)),
        do: bb_take(unquote(rest), unquote_splicing(taken))
    end
  end

  defp final_clause(fields) do
    vars = Enum.map(fields, & &1.var)

    prepared =
      for %{prepare: p, var: v} when p != nil <- fields, do: quote(do: unquote(v) = unquote(p))

    values = Enum.map(fields, &{&1.key, &1.value})

    steps =
      for(%{check: {:test, test}} <- fields, test != true, do: quote(do: true <- unquote(test))) ++
        for %{check: {:cast, cast}, var: v} <- fields,
            do: quote(do: {:ok, unquote(v)} <- unquote(cast))

    quote generated: true do
      defp bb_take([], unquote_splicing(vars)) do
        unquote_splicing(prepared)
        blank = __struct__()

        unquote(with_steps(steps, quote(do: %{blank | unquote_splicing(values)})))
      end
    end
  end

  defp with_steps([], result), do: result

  defp with_steps(steps, result) do
    refused = quote(do: (_ -> :refused))
    {:with, [], steps ++ [[do: result, else: refused]]}
  end

  # An expression that is true for the values of a type, with the functions that it calls; nil where there is none.
  defp test(:any, _var, _name), do: {true, []}
  defp test(:float, var, _), do: {quote(do: is_float(unquote(var))), []}
  defp test(:integer, var, _), do: {quote(do: is_integer(unquote(var))), []}
  defp test(:number, var, _), do: {quote(do: is_number(unquote(var))), []}
  defp test(:boolean, var, _), do: {quote(do: is_boolean(unquote(var))), []}
  defp test(:string, var, _), do: {quote(do: is_binary(unquote(var))), []}
  defp test(:atom, var, _), do: {quote(do: is_atom(unquote(var))), []}
  defp test(:pid, var, _), do: {quote(do: is_pid(unquote(var))), []}
  defp test(:reference, var, _), do: {quote(do: is_reference(unquote(var))), []}
  defp test(nil, var, _), do: {quote(do: is_nil(unquote(var))), []}

  defp test(:pos_integer, var, _),
    do: {quote(do: is_integer(unquote(var)) and unquote(var) > 0), []}

  defp test(:non_neg_integer, var, _),
    do: {quote(do: is_integer(unquote(var)) and unquote(var) >= 0), []}

  defp test({:literal, value}, var, _),
    do: {quote(do: unquote(var) === unquote(Macro.escape(value))), []}

  defp test({:in, choices}, var, _) when is_list(choices),
    do: {quote(do: unquote(var) in unquote(Macro.escape(choices))), []}

  defp test({:struct, module}, var, _),
    do: {quote(do: is_struct(unquote(var), unquote(module))), []}

  defp test({:or, types}, var, name),
    do: join(types, fn _ -> var end, name, false, &quote(do: unquote(&1) or unquote(&2)))

  defp test({:tuple, types}, var, name) do
    element = &quote(do: elem(unquote(var), unquote(&1)))
    both = &quote(do: unquote(&1) and unquote(&2))

    with {elements, helpers} <- join(types, element, name, true, both) do
      size =
        quote(do: is_tuple(unquote(var)) and tuple_size(unquote(var)) == unquote(length(types)))

      {both.(size, elements), helpers}
    end
  end

  defp test({:list, type}, var, name) do
    element = Macro.var(:element, __MODULE__)

    with {test, helpers} <- test(type, element, name ++ [:each]) do
      {call, helper} = all(name, element, test)
      {quote(do: unquote(call)(unquote(var))), [helper | helpers]}
    end
  end

  defp test(_type, _var, _name), do: nil

  defp join([], _var, _name, empty, _operator), do: {empty, []}

  defp join(types, var, name, _empty, operator) do
    tests = for {type, i} <- Enum.with_index(types), do: test(type, var.(i), name ++ [i])

    if Enum.all?(tests) do
      {tests, helpers} = Enum.unzip(tests)
      {Enum.reduce(tests, &operator.(&2, &1)), List.flatten(helpers)}
    end
  end

  defp all(name, element, test) do
    function = name |> Enum.join("_") |> String.to_atom()

    helper =
      quote generated: true do
        defp unquote(function)([unquote(element) | rest]),
          do: unquote(test) and unquote(function)(rest)

        defp unquote(function)([]), do: true
        defp unquote(function)(_), do: false
      end

    {function, helper}
  end
end

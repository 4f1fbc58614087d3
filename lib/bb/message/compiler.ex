defmodule BB.Message.Compiler do
  @moduledoc false
  # Compiles the constructor of a payload from its schema: a function with an argument for each
  # field. It takes the attributes one by one and then tests them all in one expression.
  # Attributes that it refuses go to BB.Options, which decides and words the error.
  #
  # The schema [celsius: [type: :float]] becomes
  #
  #     def __payload__(attrs) do
  #       case bb_take(attrs, :"$unset") do
  #         :refused -> BB.Message.Compiler.validate(__MODULE__, attrs)
  #         payload -> {:ok, payload}
  #       end
  #     end
  #
  #     defp bb_take([{:celsius, value} | rest], :"$unset"), do: bb_take(rest, value)
  #
  #     defp bb_take([], celsius) do
  #       blank = __struct__()
  #
  #       with true <- celsius === :"$unset" or is_float(celsius) do
  #         %{blank | celsius: if(celsius === :"$unset", do: blank.celsius, else: celsius)}
  #       else
  #         _ -> :refused
  #       end
  #     end
  #
  #     defp bb_take(_attrs, _), do: :refused

  alias BB.Message.Compiler.TypeTest
  alias BB.Options

  @unset :"$unset"

  @doc """
  Returns the checked schema of `use BB.Message, schema: …`.

  Raises ArgumentError or CompileError if it is wrong.
  """
  def schema!(opts, env) do
    schema =
      case opts do
        [schema: schema] ->
          Options.new!(schema)

        _ ->
          raise ArgumentError, "expected use BB.Message with schema: alone, got: #{inspect(opts)}"
      end

    unless Module.defines?(env.module, {:__struct__, 0}) do
      fail(
        env,
        "expected a struct in #{inspect(env.module)}; put defstruct before use BB.Message"
      )
    end

    schema
  end

  @doc "Returns whether a loaded module is a payload: a struct with a schema."
  def payload?(module) do
    compiled?(module) or
      (function_exported?(module, :schema, 0) and function_exported?(module, :__struct__, 0))
  end

  @doc "Returns whether a loaded payload module has a constructor of its own, from this module."
  def compiled?(module), do: function_exported?(module, :__payload__, 1)

  defmacro __before_compile__(env) do
    schema = Module.get_attribute(env.module, :bb_message_schema)
    check_fields(schema, struct_fields(env), env)
    {fields, helpers} = schema.schema |> Enum.map(&field/1) |> Enum.unzip()

    quote generated: true do
      @doc "Returns the schema of the payload."
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
      Creates a message with this payload.

      Returns `{:ok, message}` or `{:error, %BB.Options.ValidationError{}}`. The attributes are:

      #{BB.Options.docs(@bb_message_schema)}
      """
      @spec new(atom(), BB.Message.attrs()) ::
              {:ok, BB.Message.t()} | {:error, BB.Options.ValidationError.t()}
      def new(frame_id, attrs)
          when is_atom(frame_id) and (is_list(attrs) or is_map(attrs)) do
        case __payload__(attrs) do
          {:ok, payload} -> {:ok, BB.Message.wrap(payload, frame_id)}
          error -> error
        end
      end
    end
  end

  @doc """
  Creates a payload with the checks of BB.Options, from attributes that the constructor refuses.
  """
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

  # Macro.struct_info!/2 replaces Macro.struct!/2 since Elixir 1.18.
  defp struct_fields(env) do
    if function_exported?(Macro, :struct_info!, 2),
      do: Macro |> apply(:struct_info!, [env.module, env]) |> Enum.map(& &1.field),
      else: Macro |> apply(:struct!, [env.module, env]) |> Map.delete(:__struct__) |> Map.keys()
  end

  defp check_fields(schema, fields, env) do
    case Keyword.keys(schema.schema) -- fields do
      [] ->
        :ok

      keys ->
        fail(
          env,
          "unknown fields #{inspect(keys)} in the schema of #{inspect(env.module)}, " <>
            "the fields of its struct are: #{inspect(fields)}"
        )
    end
  end

  # A field of the constructor: its argument, how a missing value is replaced, the check of the
  # value, and the expression of the final value; with the helpers that the check calls.
  defp field({key, spec}) do
    var = Macro.var(key, __MODULE__.Field)
    {test, helpers} = check_or_cast(key, spec, var)
    {Map.merge(%{key: key, var: var}, describe_field(key, spec, var, test)), helpers}
  end

  defp check_or_cast(key, spec, var) do
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

      test = TypeTest.new(spec[:type], var, [:bb_all, key]) ->
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

  defp describe_field(key, spec, var, check) do
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

  # The first value of a key counts. A second one, whose argument is set already, is left to
  # BB.Options.
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
      for(%{check: {:test, t}} <- fields, t != true, do: quote(do: true <- unquote(t))) ++
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
end

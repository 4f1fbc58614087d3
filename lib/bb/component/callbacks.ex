defmodule BB.Component.Callbacks do
  @moduledoc """
  The code that `use BB.Sensor`, `use BB.Actuator` and `use BB.Controller` put into a callback
  module: the defaults of the optional callbacks, and the schema of its options.

  `BB.Component.Kind` calls it.
  """
  @moduledoc no_example: "internal: BB.Sensor shows a callback module"

  @doc "Returns the code for `use Kind, opts`."
  @spec code(module(), Macro.t()) :: Macro.t()
  def code(kind, opts) do
    quote do
      @behaviour unquote(kind)
      @before_compile BB.Component.Callbacks
      @bb_options_schema BB.Component.Callbacks.declared_schema(unquote(opts))

      @doc false
      def handle_options(_new_options, state), do: {:ok, state}

      @doc false
      def handle_call(_request, _from, state), do: {:reply, {:error, :not_implemented}, state}

      @doc false
      def handle_cast(_request, state), do: {:noreply, state}

      @doc false
      def handle_info(_message, state), do: {:noreply, state}

      @doc false
      def handle_continue(_argument, state), do: {:noreply, state}

      @doc false
      def terminate(_reason, _state), do: :ok

      defoverridable handle_options: 2,
                     handle_call: 3,
                     handle_cast: 2,
                     handle_info: 2,
                     handle_continue: 2,
                     terminate: 2
    end
  end

  @doc false
  def declared_schema(opts) do
    case Keyword.validate!(opts, [:options_schema]) do
      [options_schema: schema] -> {:ok, BB.Options.new!(schema)}
      [] -> :error
    end
  end

  @doc false
  defmacro __before_compile__(env) do
    declared = Module.get_attribute(env.module, :bb_options_schema)

    case {declared, Module.defines?(env.module, {:options_schema, 0})} do
      {{:ok, _schema}, true} -> raise CompileError, declared_twice(env)
      {{:ok, schema}, false} -> schema_code(schema)
      {:error, true} -> nil
      {:error, false} -> schema_code(BB.Options.new!([]))
    end
  end

  defp declared_twice(env) do
    [
      file: env.file,
      line: env.line,
      description:
        "expected one options schema in #{inspect(env.module)}, got: options_schema/0 and " <>
          "`options_schema:`. Declare the schema one way, not both"
    ]
  end

  defp schema_code(schema) do
    quote do
      @doc false
      def options_schema, do: unquote(Macro.escape(schema))
    end
  end
end

defmodule BB.Error do
  @moduledoc """
  Defines errors: exceptions with a class, fields and a severity.

  Functions return them in `{:error, error}`, and `raise` takes them too. Use one of the errors
  below `BB.Error`, or define one for a driver:

      defmodule BB.Error.Hardware.Overheated do
        use BB.Error, class: :hardware, fields: [:device, :celsius]

        defimpl BB.Error.Severity do
          def severity(_error), do: :critical
        end

        def message(%{device: device, celsius: celsius}),
          do: "device \#{device} is at \#{celsius} °C"
      end

  The module implements `BB.Error.Severity` in its body, otherwise it does not compile, and
  defines `message/1`. Its struct has the fields, `nil` by default, and the field `class`.

      iex> error = BB.Error.Hardware.Timeout.exception(device: :servo, operation: :ping)
      iex> {error.class, error.device, error.timeout_ms}
      {:hardware, :servo, nil}
      iex> BB.Error.severity(error)
      :error
      iex> BB.Error.critical?(%BB.Error.Safety.EmergencyStop{source: :button})
      true

  | class | errors of |
  |---|---|
  | `:hardware` | buses and devices |
  | `:invalid` | commands, configurations, parameters and topologies |
  | `:state` | the state of a robot or its commands |
  | `:kinematics` | links, joints and poses |
  | `:safety` | what endangers people or the robot |
  | `:protocol` | the protocols of devices, for drivers |
  """

  alias BB.Error.Severity

  @typedoc "An error of a module that uses `BB.Error`."
  @type t :: %{
          :__struct__ => module(),
          :__exception__ => true,
          :class => atom(),
          optional(atom()) => term()
        }

  @typedoc "How bad an error is."
  @type severity :: :critical | :error | :warning

  @doc """
  Defines the exception. Options: `class:`, an atom, and `fields:`, a list of atoms or of
  `{field, default}`.
  """
  defmacro __using__(opts) do
    quote do
      @after_compile BB.Error
      @before_compile BB.Error

      defexception BB.Error.__fields__(__MODULE__, unquote(opts))
    end
  end

  @doc false
  defmacro __before_compile__(env) do
    unless Module.defines_type?(env.module, {:t, 0}) do
      quote do
        @typedoc "The error, with its fields."
        @type t :: %__MODULE__{}
      end
    end
  end

  @doc false
  def __after_compile__(env, _bytecode) do
    case Code.ensure_compiled(Module.concat(Severity, env.module)) do
      {:module, _implementation} ->
        :ok

      {:error, _reason} ->
        compile_error!(env, """
        #{inspect(env.module)} does not implement BB.Error.Severity; add this in the module:

            defimpl BB.Error.Severity do
              def severity(_error), do: :error
            end
        """)
    end
  end

  @doc false
  def __fields__(module, opts) do
    with [] <- Keyword.keys(opts) -- [:class, :fields],
         class when is_atom(class) and class != nil <- opts[:class],
         fields when is_list(fields) <- Keyword.get(opts, :fields, []),
         fields = Enum.map(fields, &field/1),
         true <- Enum.all?(fields, &match?({name, _default} when is_atom(name), &1)) do
      Keyword.put(fields, :class, class)
    else
      _invalid ->
        raise ArgumentError,
              "expected `use BB.Error, class: atom, fields: [atoms]` in #{inspect(module)}, " <>
                "got: #{inspect(opts)}"
    end
  end

  defp field({name, default}), do: {name, default}
  defp field(name), do: {name, nil}

  defp compile_error!(env, text),
    do: raise(CompileError, file: env.file, line: env.line, description: String.trim(text))

  @doc """
  Returns how bad an error is: `:critical`, `:error` or `:warning`.

  Raises `Protocol.UndefinedError` for a value that is no such error.
  """
  @spec severity(t() | term()) :: severity()
  def severity(error) do
    case Severity.impl_for(error) || late_implementation(error) do
      nil -> Severity.severity(error)
      implementation -> implementation.severity(error)
    end
  end

  @doc "Returns whether the severity of an error is `:critical`."
  @spec critical?(t() | term()) :: boolean()
  def critical?(error), do: severity(error) == :critical

  # A protocol that is consolidated does not find an error that was compiled later, such as one of
  # a script.
  defp late_implementation(%module{}) do
    implementation = Module.concat(Severity, module)
    if Code.ensure_loaded?(implementation), do: implementation
  end

  defp late_implementation(_no_struct), do: nil
end

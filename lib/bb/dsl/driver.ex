defmodule BB.Dsl.Driver do
  @moduledoc """
  Asks the module of a component, while the robot compiles, whether its options are right and
  whether it reports a position. `BB.Dsl.Warnings` uses it.

  The module is code of others: it may raise or never return, and has to end neither the
  compilation nor its time. So it runs by `BB.Callback`. Without an answer there is no warning;
  the options are checked again when the robot starts.
  """
  @moduledoc no_example: "internal: BB.Dsl.Warnings prints its answers"

  alias BB.Callback
  alias BB.Options.ValidationError
  alias BB.Parameter.Reference

  @timeout_ms 2_000

  @doc """
  Checks the options of a module. An option that refers to a parameter counts as given, and any
  value of it as right. Returns `:ok` also where there is no answer.
  """
  @spec check(module(), keyword()) :: :ok | {:error, ValidationError.t()}
  def check(module, options) do
    case ask(:validate, module, options) do
      {:ok, {:error, %ValidationError{} = error}} -> {:error, error}
      _right_or_no_answer -> :ok
    end
  end

  @doc "Returns whether a module reports positions. It counts as reporting if it does not answer."
  @spec reports_position?(module(), keyword()) :: boolean()
  def reports_position?(module, options) do
    cond do
      not Code.ensure_loaded?(module) -> true
      not function_exported?(module, :capabilities, 1) -> false
      true -> ask(:position?, module, options) != {:ok, false}
    end
  end

  defp ask(question, module, options) do
    Callback.call({__MODULE__, question, [module, options]},
      name: "the check of the options of #{inspect(module)}",
      timeout_ms: @timeout_ms,
      remember: false,
      quiet: true
    )
  end

  @doc false
  @spec validate(module(), keyword()) :: {:ok, keyword()} | {:error, ValidationError.t()}
  def validate(module, options) do
    {followed, given} = Enum.split_with(options, &match?({_key, %Reference{}}, &1))
    BB.Options.validate(given, Keyword.drop(schema(module), Keyword.keys(followed)))
  end

  @doc false
  @spec position?(module(), keyword()) :: boolean()
  def position?(module, options) do
    given = Enum.reject(options, &match?({_key, %Reference{}}, &1))

    defaults =
      for {key, spec} <- schema(module), {:ok, default} <- [Keyword.fetch(spec, :default)] do
        {key, default}
      end

    :position_feedback in List.wrap(module.capabilities(Keyword.merge(defaults, given)))
  end

  defp schema(module) do
    case function_exported?(module, :options_schema, 0) && module.options_schema() do
      false -> []
      %{schema: schema} -> schema
      schema -> schema
    end
  end
end

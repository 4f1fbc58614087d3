defmodule BB.Options.SparkType do
  @moduledoc false
  # Translates the types that only Spark.Options has into those of BB.Options, for the schemas of
  # drivers that were written for it.

  @doc "Returns the type of BB.Options with the same meaning: `{:ok, type}`, or `:error`."
  @spec translate(term()) :: {:ok, term()} | :error
  def translate(:fun), do: {:ok, {:custom, __MODULE__, :check_function, []}}
  def translate(:struct), do: {:ok, {:custom, __MODULE__, :check_struct, []}}
  def translate(:regex), do: {:ok, {:struct, Regex}}
  def translate(type) when type in [:literal, :quoted], do: {:ok, :any}
  def translate({:fun, arguments}) when is_list(arguments), do: {:ok, {:fun, length(arguments)}}
  def translate({:fun, arguments, _returned}), do: translate({:fun, arguments})
  def translate({:mfa_or_fun, arity}), do: {:ok, {:or, [{:fun, arity}, :mfa]}}
  def translate({:one_of, choices}), do: {:ok, {:in, choices}}
  def translate({:tagged_tuple, tag, type}), do: {:ok, {:tuple, [{:literal, tag}, type]}}
  def translate({:spark_behaviour, module, _builtins}), do: translate({:spark_behaviour, module})

  def translate({:spark_behaviour, module}) do
    module = {:behaviour, module}
    {:ok, {:or, [module, {:tuple, [module, :keyword_list]}]}}
  end

  def translate(_type), do: :error

  @doc false
  def check_function(value) when is_function(value), do: {:ok, value}
  def check_function(value), do: {:error, "expected function, got: #{inspect(value)}"}

  @doc false
  def check_struct(value) when is_struct(value), do: {:ok, value}
  def check_struct(value), do: {:error, "expected struct, got: #{inspect(value)}"}
end

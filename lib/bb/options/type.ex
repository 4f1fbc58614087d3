defmodule BB.Options.Type do
  @moduledoc false
  # Checks a value against a type, and a type itself. Errors are sentences that name the option.

  alias BB.Options.{Schema, SimpleType, SparkType}

  @nesting [:keyword_list, :non_empty_keyword_list, :map]
  @basic Enum.sort(SimpleType.types() ++ @nesting)

  @parameterized [
    "{:behaviour, module}",
    "{:custom, module, function, args}",
    "{:fun, arity}",
    "{:in, choices}",
    "{:list, type}",
    "{:literal, value}",
    "{:map, key_type, value_type}",
    "{:or, types}",
    "{:struct, module}",
    "{:tuple, types}",
    "{:wrap_list, type}"
  ]

  @doc """
  Checks a type. Returns `{:ok, type}` with the defaults of nested schemas filled in, or
  `{:error, message}`.
  """
  def check(type) when type in @basic, do: {:ok, type}
  def check({:in, choices}), do: {:ok, {:in, choices}}
  def check({:literal, value}), do: {:ok, {:literal, value}}
  def check({:fun, arity}) when is_integer(arity) and arity >= 0, do: {:ok, {:fun, arity}}
  def check({:struct, module}) when is_atom(module), do: {:ok, {:struct, module}}
  def check({:behaviour, module}) when is_atom(module), do: {:ok, {:behaviour, module}}

  def check({:custom, module, function, args} = type)
      when is_atom(module) and is_atom(function) and is_list(args),
      do: {:ok, type}

  def check({:or, types}) when is_list(types), do: check_subtypes(:or, types)
  def check({:tuple, types}) when is_list(types), do: check_subtypes(:tuple, types)
  def check({:list, type}), do: check_subtype(:list, type)
  def check({:wrap_list, type}), do: check_subtype(:wrap_list, type)

  def check({:map, key_type, value_type}) do
    with {:ok, {:map, [key_type, value_type]}} <- check_subtypes(:map, [key_type, value_type]) do
      {:ok, {:map, key_type, value_type}}
    end
  end

  def check(type) do
    case SparkType.translate(type) do
      {:ok, type} -> check(type)
      :error -> {:error, unknown_type(type)}
    end
  end

  defp unknown_type(type), do: "unknown type #{inspect(type)}.\n\nAvailable types: #{known()}"

  @doc "Returns the list of all types, as text."
  def known, do: Enum.join(Enum.map(@basic, &inspect/1) ++ @parameterized, ", ")

  defp check_subtypes(name, types) do
    Enum.reduce_while(types, {:ok, []}, fn type, {:ok, checked} ->
      case check_subtype(name, type) do
        {:ok, {^name, type}} -> {:cont, {:ok, [type | checked]}}
        error -> {:halt, error}
      end
    end)
    |> case do
      {:ok, checked} -> {:ok, {name, Enum.reverse(checked)}}
      error -> error
    end
  end

  defp check_subtype(name, {nesting, keys}) when nesting in @nesting do
    case Schema.check(keys) do
      {:ok, keys} -> {:ok, {name, {nesting, keys}}}
      {:error, error} -> {:error, invalid_subtype(name, Exception.message(error))}
    end
  end

  defp check_subtype(name, type) do
    case check(type) do
      {:ok, type} -> {:ok, {name, type}}
      {:error, reason} -> {:error, invalid_subtype(name, reason)}
    end
  end

  defp invalid_subtype(name, reason),
    do: "invalid subtype given to #{inspect(name)} type: #{reason}"

  @doc """
  Checks a value. Returns `{:ok, value}`, changed if the type changes values, or
  `{:error, message}` with the option `key` in the message.
  """
  def cast(type, value, key)

  @value Macro.var(:value, nil)

  for type <- SimpleType.types() do
    def cast(unquote(type), value, _key) when unquote(SimpleType.test(type, @value)),
      do: {:ok, value}
  end

  for name <- [:fun, :literal, :struct], parameter = Macro.var(:parameter, nil) do
    def cast({unquote(name), parameter}, value, _key)
        when unquote(SimpleType.test({name, parameter}, @value)),
        do: {:ok, value}
  end

  def cast(:keyword_list = type, value, key) do
    if Keyword.keyword?(value), do: {:ok, value}, else: unexpected(type, value, key)
  end

  def cast(:non_empty_keyword_list = type, value, key) do
    if value != [] and Keyword.keyword?(value),
      do: {:ok, value},
      else: unexpected(type, value, key)
  end

  def cast({:in, choices} = type, value, key) do
    if value in choices, do: {:ok, value}, else: unexpected(type, value, key)
  end

  def cast({:behaviour, behaviour} = type, value, key) do
    if is_atom(value) and implements?(value, behaviour),
      do: {:ok, value},
      else: unexpected(type, value, key)
  end

  def cast({:custom, module, function, args}, value, key) do
    case apply(module, function, [value | args]) do
      {:ok, value} ->
        {:ok, value}

      {:error, message} when is_binary(message) ->
        {:error, "invalid value for #{name(key)}: #{message}"}

      other ->
        raise "custom validation function #{inspect(module)}.#{function}/#{length(args) + 1} " <>
                "must return {:ok, value} or {:error, message}, got: #{inspect(other)}"
    end
  end

  def cast({:or, types}, value, key), do: cast_any(types, value, key, [])

  def cast({:list, type}, value, key) when is_list(value) do
    if List.improper?(value),
      do: unexpected({:list, type}, value, key),
      else: cast_elements(value, type, key, 0, [])
  end

  def cast({:wrap_list, type}, value, key), do: cast({:list, type}, List.wrap(value), key)

  def cast({:tuple, types}, value, key) when tuple_size(value) == length(types) do
    types
    |> Enum.zip(Tuple.to_list(value))
    |> cast_all(fn {{type, element}, index} -> cast(type, element, {:tuple, index}) end)
    |> case do
      {:ok, elements} -> {:ok, List.to_tuple(elements)}
      {:error, reason} -> {:error, "invalid tuple in #{name(key)}: #{reason}"}
    end
  end

  def cast(:map, value, key), do: cast({:map, :atom, :any}, value, key)

  def cast({:map, key_type, value_type}, value, key)
      when is_map(value) and not is_struct(value) do
    value
    |> Enum.sort()
    |> cast_all(fn {{k, v}, _index} -> cast_pair(key_type, value_type, k, v) end)
    |> case do
      {:ok, pairs} -> {:ok, Map.new(pairs)}
      {:error, reason} -> {:error, "invalid map in #{name(key)}: #{reason}"}
    end
  end

  def cast(type, value, key), do: unexpected(type, value, key)

  defp cast_any([], _value, key, reasons) do
    {:error,
     "expected #{name(key)} to match at least one given type, but didn't match any. " <>
       "Here are the reasons why it didn't match each of the allowed types:\n\n" <>
       Enum.map_join(reasons, "\n", &("  * " <> &1))}
  end

  defp cast_any([type | rest], value, key, reasons) do
    case cast_alternative(type, value, key) do
      {:ok, value} -> {:ok, value}
      {:error, reason} -> cast_any(rest, value, key, [reason | reasons])
    end
  end

  defp cast_elements([], _type, _key, _index, cast), do: {:ok, Enum.reverse(cast)}

  defp cast_elements([element | rest], {nesting, keys}, key, index, cast)
       when nesting in @nesting do
    with {:ok, element} <- cast_in_list(nesting, element, key, index),
         {:ok, element} <- Schema.validate_nested(element, keys, key) do
      cast_elements(rest, {nesting, keys}, key, index + 1, [element | cast])
    else
      {:error, %{message: message}} ->
        {:error, "invalid list element at position #{index} in #{name(key)}: #{message}"}

      {:error, message} ->
        {:error, message}
    end
  end

  defp cast_elements([element | rest], type, key, index, cast) do
    with {:ok, element} <- cast_in_list(type, element, key, index) do
      cast_elements(rest, type, key, index + 1, [element | cast])
    end
  end

  defp cast_in_list(type, element, key, index) do
    with {:error, reason} <- cast(type, element, {:list, index}) do
      {:error, "invalid list in #{name(key)}: #{reason}"}
    end
  end

  defp cast_alternative({nesting, keys}, value, key) when nesting in @nesting do
    with {:ok, value} <- cast(nesting, value, key),
         {:error, error} <- Schema.validate_nested(value, keys, key) do
      {:error, Exception.message(error)}
    end
  end

  defp cast_alternative(type, value, key), do: cast(type, value, key)

  defp cast_pair(key_type, value_type, k, v) do
    with {:ok, k} <- cast(key_type, k, {:map_key}),
         {:ok, v} <- cast(value_type, v, {:map_value, k}) do
      {:ok, {k, v}}
    end
  end

  defp cast_all(elements, cast) do
    elements
    |> Enum.with_index()
    |> Enum.reduce_while([], fn element, done ->
      case cast.(element) do
        {:ok, value} -> {:cont, [value | done]}
        {:error, reason} -> {:halt, {:error, reason}}
      end
    end)
    |> case do
      {:error, reason} -> {:error, reason}
      done -> {:ok, Enum.reverse(done)}
    end
  end

  defp implements?(module, behaviour) do
    Code.ensure_loaded?(module) and
      behaviour in (module.module_info(:attributes)
                    |> Keyword.get_values(:behaviour)
                    |> List.flatten())
  end

  defp unexpected({:fun, arity}, value, key) when is_function(value) do
    {:arity, got} = Function.info(value, :arity)

    {:error,
     "invalid value for #{name(key)}: expected #{SimpleType.expected({:fun, arity})}, " <>
       "got: function of arity #{got}"}
  end

  defp unexpected(type, value, key),
    do:
      {:error,
       "invalid value for #{name(key)}: expected #{expected(type, value)}, " <>
         "got: #{inspect(value)}"}

  defp expected(:keyword_list, _), do: "keyword list"
  defp expected(:non_empty_keyword_list, _), do: "non-empty keyword list"
  defp expected({:behaviour, module}, _), do: "module that implements #{inspect(module)}"
  defp expected({:list, _}, _), do: "list"
  defp expected(:map, _), do: "map"
  defp expected({:map, _, _}, _), do: "map"

  defp expected({:tuple, types}, value) when is_tuple(value),
    do: "tuple with #{length(types)} elements"

  defp expected({:tuple, _}, _), do: "tuple"
  defp expected(type, _), do: SimpleType.expected(type)

  defp name({:list, index}), do: "list element at position #{index}"
  defp name({:tuple, index}), do: "tuple element at position #{index}"
  defp name({:map_key}), do: "map key"
  defp name({:map_value, key}), do: "map key #{inspect(key)}"
  defp name(key), do: "#{inspect(key)} option"
end

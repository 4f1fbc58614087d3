defmodule BB.Options.SimpleType do
  @moduledoc false
  # The one description of each simple type, a type that a single expression tests: the expression
  # itself, the words for it in errors, and the words for it in docs.
  #
  # BB.Options.Type makes its function clauses from it, BB.Message.Compiler the constructors of
  # payloads, and BB.Options.Docs its lists.

  @types [
    :any,
    :atom,
    :boolean,
    :float,
    :integer,
    :mfa,
    :mod_arg,
    :module,
    :non_neg_integer,
    :number,
    :pid,
    :pos_integer,
    :reference,
    :string,
    :timeout,
    nil
  ]

  @doc "The simple types without a parameter."
  @spec types() :: [atom()]
  def types, do: @types

  @doc """
  Returns a quoted expression that is true for the values of the type, or `nil` if the type is not
  a simple one.

  `var` is the quoted variable of the value. A parameter of the type is quoted too. Apart from
  `{:in, choices}` with choices that are no literal, the expression is allowed in guards.
  """
  @spec test(term(), Macro.t()) :: Macro.t() | nil
  def test(:any, _var), do: true
  def test(:atom, var), do: quote(do: is_atom(unquote(var)))
  def test(:boolean, var), do: quote(do: is_boolean(unquote(var)))
  def test(:float, var), do: quote(do: is_float(unquote(var)))
  def test(:integer, var), do: quote(do: is_integer(unquote(var)))
  def test(:number, var), do: quote(do: is_number(unquote(var)))
  def test(:pid, var), do: quote(do: is_pid(unquote(var)))
  def test(:reference, var), do: quote(do: is_reference(unquote(var)))
  def test(:string, var), do: quote(do: is_binary(unquote(var)))
  def test(nil, var), do: quote(do: is_nil(unquote(var)))
  def test(:pos_integer, var), do: quote(do: is_integer(unquote(var)) and unquote(var) > 0)
  def test(:non_neg_integer, var), do: quote(do: is_integer(unquote(var)) and unquote(var) >= 0)

  def test(:timeout, var),
    do: quote(do: unquote(var) === :infinity or unquote(test(:non_neg_integer, var)))

  def test(:module, var),
    do: quote(do: is_atom(unquote(var)) and unquote(var) not in [nil, true, false])

  def test(:mfa, var) do
    quote do
      is_tuple(unquote(var)) and tuple_size(unquote(var)) == 3 and
        is_atom(elem(unquote(var), 0)) and is_atom(elem(unquote(var), 1)) and
        is_list(elem(unquote(var), 2))
    end
  end

  def test(:mod_arg, var) do
    quote do
      is_tuple(unquote(var)) and tuple_size(unquote(var)) == 2 and is_atom(elem(unquote(var), 0))
    end
  end

  def test({:fun, arity}, var), do: quote(do: is_function(unquote(var), unquote(arity)))
  def test({:literal, value}, var), do: quote(do: unquote(var) === unquote(value))
  def test({:struct, module}, var), do: quote(do: is_struct(unquote(var), unquote(module)))
  def test({:in, choices}, var), do: quote(do: unquote(var) in unquote(choices))
  def test(_type, _var), do: nil

  @doc "The words after \"expected\" in an error, or `nil` if the type is not a simple one."
  @spec expected(term()) :: String.t() | nil
  def expected(:non_neg_integer), do: "non negative integer"
  def expected(:pos_integer), do: "positive integer"
  def expected(:timeout), do: "non-negative integer or :infinity"
  def expected(:mfa), do: "tuple {mod, fun, args}"
  def expected(:mod_arg), do: "tuple {mod, arg}"
  def expected(nil), do: "nil"
  def expected(type) when type in @types, do: Atom.to_string(type)
  def expected({:fun, arity}), do: "function of arity #{arity}"
  def expected({:literal, value}), do: inspect(value)
  def expected({:struct, module}), do: inspect(module)
  def expected({:in, choices}), do: "one of #{inspect(choices)}"
  def expected(_type), do: nil

  @doc "The type in Markdown, or `nil` if its description would not be short."
  @spec docs(term()) :: String.t() | nil
  def docs(:any), do: "`t:term/0`"
  def docs(:string), do: "`t:String.t/0`"
  def docs(type) when type in [nil, :mfa, :mod_arg], do: nil
  def docs(type) when type in @types, do: "`t:#{type}/0`"
  def docs({:fun, arity}), do: "function of arity #{arity}"
  def docs({:literal, value}), do: "`#{inspect(value)}`"
  def docs({:struct, module}), do: "struct of type `#{inspect(module)}`"
  def docs(_type), do: nil
end

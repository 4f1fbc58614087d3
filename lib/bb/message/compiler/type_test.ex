defmodule BB.Message.Compiler.TypeTest do
  @moduledoc false
  # Turns the type of a field into an expression that is true for its values. Simple types have
  # one in BB.Options.SimpleType; those made of others join theirs. A list needs a private
  # function of the payload's module, a helper, that walks it.

  alias BB.Options.SimpleType

  @typedoc "An expression, and the definitions of the functions that it calls."
  @type t :: {Macro.t(), helpers :: [Macro.t()]}

  @doc """
  Returns the test of a type, or `nil` if only `BB.Options` can check it.

  `var` is the quoted variable of the value. `name` is a list of terms that makes the names of the
  helpers unique.
  """
  @spec new(term(), Macro.t(), [term()]) :: t() | nil
  def new({:or, types}, var, name),
    do: join(types, fn _ -> var end, name, false, &quote(do: unquote(&1) or unquote(&2)))

  def new({:tuple, types}, var, name) do
    element = &quote(do: elem(unquote(var), unquote(&1)))
    both = &quote(do: unquote(&1) and unquote(&2))

    with {elements, helpers} <- join(types, element, name, true, both) do
      size =
        quote(do: is_tuple(unquote(var)) and tuple_size(unquote(var)) == unquote(length(types)))

      {both.(size, elements), helpers}
    end
  end

  def new({:list, type}, var, name) do
    element = Macro.var(:element, __MODULE__)

    with {test, helpers} <- new(type, element, name ++ [:each]) do
      {function, helper} = each_helper(name, element, test)
      {quote(do: unquote(function)(unquote(var))), [helper | helpers]}
    end
  end

  def new({:in, choices}, _var, _name) when not is_list(choices), do: nil

  def new(type, var, _name) do
    if test = type |> escape() |> SimpleType.test(var), do: {test, []}
  end

  defp escape({name, parameter}), do: {name, Macro.escape(parameter)}
  defp escape(type), do: type

  defp join([], _var, _name, empty, _operator), do: {empty, []}

  defp join(types, var, name, _empty, operator) do
    tests = for {type, i} <- Enum.with_index(types), do: new(type, var.(i), name ++ [i])

    if Enum.all?(tests) do
      {tests, helpers} = Enum.unzip(tests)
      {Enum.reduce(tests, &operator.(&2, &1)), List.flatten(helpers)}
    end
  end

  defp each_helper(name, element, test) do
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

defmodule BB.Test.BitStrings do
  @moduledoc """
  Finds bit-string patterns whose size is a variable from outside of the pattern.

      size = 4
      <<head::binary-size(size), rest::binary>> = bytes

  Elixir 1.20 warns about it and suggests a pin, `size(^size)`, which Elixir before 1.19 rejects.
  Code for both binds the size inside the same bit string, or uses `binary_part/3` or
  `:erlang.split_binary/2`.

      BB.Test.BitStrings.find("lib/a.ex")
      #=> [{"size(size)", 3}]
  """

  # Macros of Kernel and ExUnit whose first argument is a pattern.
  @matchers [:match?, :destructure] ++
              for(
                verb <- ~w(assert refute),
                kind <- ~w(receive received),
                do: :"#{verb}_#{kind}"
              )
  @definitions [:def, :defp, :defmacro, :defmacrop]

  @doc "Returns the sizes in a file that are bound outside of their pattern, with their lines."
  @spec find(Path.t()) :: [{String.t(), line :: pos_integer()}]
  def find(file), do: file |> File.read!() |> find(file)

  @doc "Does the same for the text of a file."
  @spec find(String.t(), Path.t()) :: [{String.t(), line :: pos_integer()}]
  def find(text, file) do
    {_ast, patterns} =
      text |> Code.string_to_quoted!(file: file) |> Macro.prewalk([], &{&1, patterns(&1) ++ &2})

    patterns |> Enum.flat_map(&foreign_sizes/1) |> Enum.uniq() |> Enum.sort_by(&elem(&1, 1))
  end

  defp patterns({operator, _, [pattern, _]}) when operator in [:=, :<-], do: [pattern]
  defp patterns({:->, _, [patterns, _]}), do: patterns
  defp patterns({matcher, _, [pattern | _]}) when matcher in @matchers, do: [pattern]
  defp patterns({kind, _, [head | _]}) when kind in @definitions, do: [head]

  # The generator of a bit string: its last part is `segment <- bytes`.
  defp patterns({:<<>>, meta, [_ | _] = parts}) do
    case List.pop_at(parts, -1) do
      {{:<-, _, [last, _bytes]}, before} -> [{:<<>>, meta, before ++ [last]}]
      _constructed_or_seen_elsewhere -> []
    end
  end

  defp patterns(_node), do: []

  defp foreign_sizes(pattern) do
    {_ast, found} = Macro.prewalk(pattern, [], &{&1, in_bit_string(&1) ++ &2})
    found
  end

  defp in_bit_string({:<<>>, _, segments}) do
    {found, _bound} =
      Enum.flat_map_reduce(segments, [], fn segment, bound ->
        {foreign(segment, bound), variables(value(segment)) ++ bound}
      end)

    found
  end

  defp in_bit_string(_node), do: []

  defp foreign({:"::", meta, [_value, type]}, bound) do
    for size <- sizes(type), variables(size) -- bound != [] or pinned?(size) do
      {"size(#{Macro.to_string(size)})", meta[:line]}
    end
  end

  defp foreign(_without_type, _bound), do: []

  defp value({:"::", _, [value, _type]}), do: value
  defp value(value), do: value

  # `binary-size(n)`, and `n*8`, which is `size(n)-unit(8)`.
  defp sizes({:-, _, [left, right]}), do: sizes(left) ++ sizes(right)
  defp sizes({:size, _, [size]}), do: [size]
  defp sizes({:*, _, [size, _unit]}), do: [size]
  defp sizes(_other), do: []

  defp variables(ast), do: ast |> Macro.prewalk([], &variable/2) |> elem(1)

  # The arguments of these are no variables of the pattern.
  defp variable({outside, _, _}, names) when outside in [:@, :unquote], do: {nil, names}

  defp variable({name, _, context} = node, names) when is_atom(name) and is_atom(context),
    do: {node, [name | names]}

  defp variable(node, names), do: {node, names}

  defp pinned?(ast),
    do: ast |> Macro.prewalk(false, &{&1, &2 or match?({:^, _, _}, &1)}) |> elem(1)
end

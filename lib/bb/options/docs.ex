defmodule BB.Options.Docs do
  @moduledoc false
  # A schema as a Markdown list.

  def generate(schema, opts),
    do: schema |> items(Keyword.get(opts, :nest_level, 0)) |> Enum.join()

  defp items(schema, level) do
    for {key, spec} <- schema, spec[:doc] != false, do: item(key, spec, level)
  end

  defp item(key, spec, level) do
    indent = String.duplicate("  ", level)

    head =
      ["#{indent}  * `#{inspect(key)}`", type_words(spec), description(spec, indent)]
      |> Enum.reject(&(&1 in [nil, ""]))
      |> Enum.join(" ")

    [head, "\n\n" | items(spec[:keys] || [], level + 1)]
  end

  defp description(spec, indent) do
    case required(spec) |> join(spec[:doc] && String.trim(spec[:doc])) |> add_default(spec) do
      nil -> nil
      text -> "- " <> indent_lines(text, indent <> "    ")
    end
  end

  defp required(spec), do: if(spec[:required], do: "Required.")

  defp add_default(text, spec) do
    case Keyword.fetch(spec, :default) do
      {:ok, default} -> join(text, "The default value is `#{inspect(default)}`.")
      :error -> text
    end
  end

  defp join(nil, text), do: text
  defp join(text, nil), do: text

  # After a text of several paragraphs the next sentence begins one of its own.
  defp join(text, more),
    do: text <> if(String.contains?(text, "\n\n"), do: "\n\n", else: " ") <> more

  defp indent_lines(text, indent) do
    [first | rest] = String.split(text, "\n")
    Enum.join([first | Enum.map(rest, &if(&1 == "", do: "", else: indent <> &1))], "\n")
  end

  defp type_words(spec) do
    case Keyword.get_lazy(spec, :type_doc, fn -> words(spec[:type]) end) do
      empty when empty in [nil, false] -> nil
      words -> "(#{words})"
    end
  end

  # Types that would not be short are left to the text.
  defp words(:any), do: "`t:term/0`"
  defp words(:string), do: "`t:String.t/0`"
  defp words(:keyword_list), do: "`t:keyword/0`"
  defp words({:keyword_list, _keys}), do: "`t:keyword/0`"
  defp words(:non_empty_keyword_list), do: "non-empty `t:keyword/0`"
  defp words({:non_empty_keyword_list, _keys}), do: "non-empty `t:keyword/0`"
  defp words({:map, _keys}), do: "`t:map/0`"
  defp words(type) when type in [nil, :mfa, :mod_arg], do: nil
  defp words(type) when is_atom(type), do: "`t:#{type}/0`"
  defp words({:fun, arity}), do: "function of arity #{arity}"
  defp words({:struct, module}), do: "struct of type `#{inspect(module)}`"
  defp words({:behaviour, module}), do: "module that implements `#{inspect(module)}`"
  defp words({:literal, value}), do: "`#{inspect(value)}`"

  defp words({:list, type}) do
    if words = words(type), do: "list of #{words}"
  end

  defp words({:wrap_list, type}) do
    if words = words(type), do: "one or a list of #{words}"
  end

  defp words({:map, key_type, value_type}) do
    keys = words(key_type)
    values = words(value_type)
    if keys && values, do: "map of #{keys} keys and #{values} values"
  end

  defp words({:tuple, types}) do
    words = Enum.map(types, &words/1)
    if Enum.all?(words), do: "tuple of #{Enum.join(words, ", ")} values"
  end

  defp words(_type), do: nil
end

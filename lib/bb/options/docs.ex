defmodule BB.Options.Docs do
  @moduledoc false
  # Formats a schema as a Markdown list.

  alias BB.Options.SimpleType

  def generate(schema, opts),
    do: schema |> items(Keyword.get(opts, :nest_level, 0)) |> Enum.join()

  # Options with a title follow those without one, each group below its title.
  defp items(schema, level) do
    shown = for {_key, spec} = option <- schema, spec[:doc] != false, !spec[:private?], do: option
    titles = shown |> Enum.map(fn {_key, spec} -> spec[:subsection] end) |> Enum.uniq()

    for title <- Enum.sort_by(titles, &(&1 != nil)),
        do: [
          heading(title)
          | for({key, spec} <- shown, spec[:subsection] == title, do: item(key, spec, level))
        ]
  end

  defp heading(nil), do: []
  defp heading(title), do: "### #{title}\n\n"

  defp item(key, spec, level) do
    indent = String.duplicate("  ", level)

    head =
      ["#{indent}  * `#{inspect(key)}`", format_type(spec), description(spec, indent)]
      |> Enum.reject(&(&1 in [nil, ""]))
      |> Enum.join(" ")

    [head, "\n\n" | items(spec[:keys] || [], level + 1)]
  end

  defp description(spec, indent) do
    text = required(spec) |> join(spec[:doc] && String.trim(spec[:doc])) |> add_default(spec)

    case join(text, deprecated(spec)) do
      nil -> nil
      text -> "- " <> indent_lines(text, indent <> "    ")
    end
  end

  defp required(spec), do: if(spec[:required], do: "Required.")

  defp deprecated(spec), do: if(spec[:deprecated], do: "Deprecated: #{spec[:deprecated]}")

  defp add_default(text, spec) do
    case Keyword.fetch(spec, :default) do
      {:ok, default} -> join(text, "The default value is `#{inspect(default)}`.")
      :error -> text
    end
  end

  defp join(nil, text), do: text
  defp join(text, nil), do: text

  # After a text of several paragraphs the next sentence is a paragraph of its own.
  defp join(text, more),
    do: text <> if(String.contains?(text, "\n\n"), do: "\n\n", else: " ") <> more

  defp indent_lines(text, indent) do
    [first | rest] = String.split(text, "\n")
    Enum.join([first | Enum.map(rest, &if(&1 == "", do: "", else: indent <> &1))], "\n")
  end

  defp format_type(spec) do
    case Keyword.get_lazy(spec, :type_doc, fn -> describe(spec[:type]) end) do
      none when none in [nil, false] -> nil
      text -> "(#{text})"
    end
  end

  # A type whose description would not be short has none: the option's text describes it.
  defp describe(:keyword_list), do: "`t:keyword/0`"
  defp describe({:keyword_list, _keys}), do: "`t:keyword/0`"
  defp describe(:non_empty_keyword_list), do: "non-empty `t:keyword/0`"
  defp describe({:non_empty_keyword_list, _keys}), do: "non-empty `t:keyword/0`"
  defp describe(:map), do: "`t:map/0`"
  defp describe({:map, _keys}), do: "`t:map/0`"
  defp describe({:behaviour, module}), do: "module that implements `#{inspect(module)}`"

  defp describe({:list, type}) do
    if item = describe(type), do: "list of #{item}"
  end

  defp describe({:wrap_list, type}) do
    if item = describe(type), do: "one or a list of #{item}"
  end

  defp describe({:map, key_type, value_type}) do
    keys = describe(key_type)
    values = describe(value_type)
    if keys && values, do: "map of #{keys} keys and #{values} values"
  end

  defp describe({:tuple, types}) do
    elements = Enum.map(types, &describe/1)
    if Enum.all?(elements), do: "tuple of #{Enum.join(elements, ", ")} values"
  end

  defp describe(type), do: SimpleType.docs(type)
end

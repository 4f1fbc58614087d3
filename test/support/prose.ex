defmodule BB.Test.Prose do
  @moduledoc """
  Judges the form of documents, docs and error messages, as far as a machine can.

  `DocumentationTest` uses it. Each function returns what breaks a rule, with its line where there
  is one, and an empty list for a text that keeps it.

      [{3, 104}] = BB.Test.Prose.long_lines(File.read!("docs/glossary.md"), :markdown)
  """

  @columns 98

  @doc """
  Returns `{line, columns}` of each line with more than #{@columns} characters.

  Rows of tables and lines with a URL do not count, nor does code between fences in Markdown:
  these cannot be broken.
  """
  @spec long_lines(String.t(), :markdown | :elixir) :: [{pos_integer(), pos_integer()}]
  def long_lines(text, kind) do
    for {line, number} <- text |> lines(kind) |> Enum.with_index(1),
        String.length(line) > @columns,
        not (line =~ ~r/^\s*(#\s*)?\|/ or line =~ ~r{https?://}),
        do: {number, String.length(line)}
  end

  # Lines between fences are empty, so that the others keep their numbers.
  defp lines(text, :elixir), do: String.split(text, "\n")

  defp lines(text, :markdown) do
    text
    |> String.split("\n")
    |> Enum.map_reduce(false, fn line, fenced? ->
      if line =~ ~r/^\s*```/,
        do: {"", not fenced?},
        else: {if(fenced?, do: "", else: line), fenced?}
    end)
    |> elem(0)
  end

  @doc "Tells whether a text has an example: a fence, an `iex>` prompt or an indented block."
  @spec example?(String.t()) :: boolean()
  def example?(text), do: text =~ ~r/^\s*```|iex>|(\A|\n\s*\n) {4,}(?![*-] )\S/m

  @doc "Tells whether the first paragraph of a text has a sentence that ends with a full stop."
  @spec first_sentence?(String.t()) :: boolean()
  def first_sentence?(text) do
    [first | _] = text |> String.trim_leading() |> String.split(~r/\n\s*\n/, parts: 2)
    first =~ ~r/\.["”)]?(\s|\z)/
  end

  @doc """
  Returns `{line, message}` of each error message in an Elixir source that has a forbidden
  opening.

  A message is the text of a `raise`, of `{:error, "…"}`, and each text in the functions
  `exception/1` and `message/1`. What a message puts in (`\#{…}`) is read as `…`.

      iex> BB.Test.Prose.vague_messages(~S|raise ArgumentError, "what is set is no number"|)
      [{1, "what is set is no number"}]
      iex> BB.Test.Prose.vague_messages(~S|raise ArgumentError, "expected a number, got: \#{x}"|)
      []
  """
  @spec vague_messages(String.t()) :: [{pos_integer(), String.t()}]
  def vague_messages(source) do
    for {line, message} <- messages(source),
        Enum.any?(openings(), &(message =~ &1)),
        do: {line, message}
  end

  # These openings do not name what failed, what was expected or what to do.
  defp openings do
    [
      ~r/\Awhat\b/i,
      ~r/\Awho/i,
      ~r/\Athat of\b/i,
      ~r/\Athat which\b/i,
      ~r/\Anobody\b/i,
      ~r/\Asomebody\b/i,
      ~r/\Ait\b/i,
      ~r/\Athere is\b/i,
      ~r/\Aan? [^.:;,]*\bis what\b/i
    ]
  end

  @doc """
  Returns `{line, message}` of each error message in an Elixir source.

      iex> BB.Test.Prose.messages(~S|def f(x), do: {:error, "unknown option " <> x}|)
      [{1, "unknown option …"}]
  """
  @spec messages(String.t()) :: [{pos_integer(), String.t()}]
  def messages(source) do
    {_ast, found} = source |> ast() |> Macro.prewalk([], &{&1, found(&1) ++ &2})
    found |> Enum.uniq() |> Enum.sort()
  end

  # With literals wrapped, so that a text has a line.
  defp ast(source) do
    Code.string_to_quoted!(source, literal_encoder: &{:ok, {:__block__, &2, [&1]}})
  end

  defp found({raiser, _, [text]}) when raiser in [:raise, :throw], do: text(text)
  defp found({:raise, _, [_exception, text]}), do: text(text)
  defp found({:raise, _, [_exception, _options, _more]}), do: []
  defp found({:reraise, _, [text | _]}), do: text(text)
  defp found({{:., _, [{:__aliases__, _, [:Mix]}, :raise]}, _, [text | _]}), do: text(text)

  # A pair is wrapped as every literal is.
  defp found({:__block__, _, [{{:__block__, _, [:error]}, text}]}), do: text(text)

  defp found({:def, _, [head, body]}) do
    case name_and_arity(head) do
      {name, 1} when name in [:exception, :message] -> texts(body)
      _other -> []
    end
  end

  defp found(_node), do: []

  defp name_and_arity({:when, _, [head | _]}), do: name_and_arity(head)
  defp name_and_arity({name, _, arguments}) when is_list(arguments), do: {name, length(arguments)}
  defp name_and_arity(_variable), do: nil

  # The whole texts in an expression, not their parts.
  defp texts(expression) do
    {_ast, found} =
      Macro.prewalk(expression, [], fn node, found ->
        case text(node) do
          [] -> {node, found}
          text -> {nil, text ++ found}
        end
      end)

    found
  end

  # A text as far as it is written, with its line; nothing for what is no text.
  defp text({:__block__, meta, [text]}) when is_binary(text), do: [{meta[:line], text}]

  defp text({:<<>>, meta, parts}) do
    if Enum.any?(parts, &is_binary/1),
      do: [{meta[:line], Enum.map_join(parts, &if(is_binary(&1), do: &1, else: "…"))}],
      else: []
  end

  defp text({:<>, _, [left, right]}) do
    case {text(left), text(right)} do
      {[], []} -> []
      {[], [{line, right}]} -> [{line, "…" <> right}]
      {[{line, left}], []} -> [{line, left <> "…"}]
      {[{line, left}], [{_, right}]} -> [{line, left <> right}]
    end
  end

  defp text({:__block__, _, [[_ | _] = options]}), do: text(options)

  defp text(options) when is_list(options) do
    for {{:__block__, _, [:message]}, text} <- options, found <- text(text), do: found
  end

  defp text(_other), do: []
end

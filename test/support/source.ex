defmodule BB.Test.Source do
  @moduledoc """
  What an Elixir source file defines and names.

  The source is read, not the compiled module: a module names what stands in its source. Its BEAM file has lost aliases, types
  and the structs of patterns, and has gained what the macros of others put in, so that every driver would seem to name
  what is behind `use BB.Sensor`.

  Names that are made while the program runs, such as `Module.concat(robot, PubSub)`, are not seen; nor is text, documentation
  for one.
  """

  @enforce_keys [:file]
  defstruct [:file, modules: [], names: [], doctests: []]

  @typedoc """
  `modules` are those that it defines, `names` all in it that are names of modules, with their lines and aliases written out,
  `doctests` the modules given to `doctest`, with its options. All in the order of the source.
  """
  @type t :: %__MODULE__{
          file: Path.t(),
          modules: [module()],
          names: [{module(), line :: pos_integer()}],
          doctests: [{module(), opts :: [Macro.t()]}]
        }

  @doc "Reads a file."
  @spec read!(Path.t()) :: t()
  def read!(file), do: file |> File.read!() |> parse!(file)

  @doc "Reads the text of a file."
  @spec parse!(String.t(), Path.t()) :: t()
  def parse!(text, file) do
    start = %{modules: [], names: [], doctests: [], outer: [], aliases: [%{}], line: 1}
    ast = Code.string_to_quoted!(text, file: file)
    {_ast, found} = Macro.traverse(ast, start, &enter/2, &leave/2)

    %__MODULE__{
      file: file,
      modules: Enum.reverse(found.modules),
      names: Enum.reverse(found.names),
      doctests: Enum.reverse(found.doctests)
    }
  end

  # A node that has been read in full becomes nil, lest its parts be read again.

  defp enter({:defmodule, meta, [{:__aliases__, _, parts}, body]}, found) do
    module = Module.concat(List.wrap(List.first(found.outer)) ++ parts)
    found = %{found | modules: [module | found.modules], outer: [module | found.outer]}
    {{:defmodule, meta, [nil, body]}, found}
  end

  defp enter({:alias, meta, [target | opts]} = node, found) do
    case targets(target, found) do
      [] -> {node, found}
      modules -> {nil, found |> name(modules, meta) |> shorten(modules, opts)}
    end
  end

  defp enter({:doctest, _meta, [target | opts]} = node, found) do
    doctests = Enum.map(targets(target, found), &{&1, opts})
    {node, %{found | doctests: doctests ++ found.doctests}}
  end

  defp enter({:__aliases__, meta, _} = node, found) do
    case targets(node, found) do
      [] -> {node, found}
      modules -> {nil, name(found, modules, meta)}
    end
  end

  # An alias holds to the end of its block.
  defp enter({:do, _} = node, found),
    do: {node, %{found | aliases: [hd(found.aliases) | found.aliases]}}

  defp enter({_, meta, _} = node, found) when is_list(meta),
    do: {node, %{found | line: Keyword.get(meta, :line, found.line)}}

  defp enter(atom, found) when is_atom(atom) do
    if match?("Elixir." <> _, Atom.to_string(atom)),
      do: {atom, name(found, [atom], line: found.line)},
      else: {atom, found}
  end

  defp enter(node, found), do: {node, found}

  defp leave({:defmodule, _, [nil, _]} = node, found) do
    [module | outer] = found.outer
    found = %{found | outer: outer}
    {node, if(outer == [], do: found, else: shorten(found, [module], []))}
  end

  defp leave({:do, _} = node, found), do: {node, %{found | aliases: tl(found.aliases)}}
  defp leave(node, found), do: {node, found}

  # The modules that an expression names: one, several (`A.{B, C}`), or none that can be read.
  defp targets({:__aliases__, _, parts}, found), do: List.wrap(expand(parts, found))

  defp targets({{:., _, [{:__aliases__, _, parts}, :{}]}, _, members}, found) do
    for {:__aliases__, _, member} <- members, do: expand(parts ++ member, found)
  end

  defp targets(_other, _found), do: []

  defp expand([{:__MODULE__, _, _} | rest], %{outer: [module | _]}), do: concat([module | rest])

  defp expand([first | rest], found) when is_atom(first),
    do: concat([Map.get(hd(found.aliases), first, first) | rest])

  defp expand(_computed, _found), do: nil

  # As far as it is written: `Parser.unquote(name)` names Parser.
  defp concat(parts), do: parts |> Enum.take_while(&is_atom/1) |> Module.concat()

  defp name(found, modules, meta) do
    line = Keyword.get(meta, :line, found.line)
    %{found | names: Enum.map(Enum.reverse(modules), &{&1, line}) ++ found.names}
  end

  defp shorten(found, [module], [[as: {:__aliases__, _, [short]}]]), do: put(found, short, module)

  defp shorten(found, modules, _opts) do
    Enum.reduce(modules, found, fn module, found ->
      put(found, module |> Module.split() |> List.last() |> String.to_atom(), module)
    end)
  end

  defp put(%{aliases: [inner | outer]} = found, short, module),
    do: %{found | aliases: [Map.put(inner, short, module) | outer]}
end

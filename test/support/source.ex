defmodule BB.Test.Source do
  @moduledoc """
  Reads which modules an Elixir source file defines and names.

  It reads the source, not the compiled module. The BEAM file has lost aliases, types and the
  structs of patterns. It also has the code of macros, so that every driver would name the modules
  behind `use BB.Sensor`.

  It does not see names that are made at run time, such as `Module.concat(robot, PubSub)`, nor
  names in text and documentation.

      BB.Test.Source.read!("lib/bb/loop.ex").modules
      #=> [BB.Loop]
  """

  @enforce_keys [:file]
  defstruct [:file, modules: [], names: [], doctests: [], calls: []]

  @typedoc """
  `modules` are the defined modules and `names` the named ones, with lines and expanded aliases.
  `doctests` are the modules given to `doctest`, with its options. `calls` are the calls of a
  module that is a value (`module.explain/1`, `fun.()`, `apply`). All are in the order of the
  source.
  """
  @type t :: %__MODULE__{
          file: Path.t(),
          modules: [module()],
          names: [{module(), line :: pos_integer()}],
          doctests: [{module(), opts :: [Macro.t()]}],
          calls: [{call(), line :: pos_integer()}]
        }

  @typedoc "The called function: its name, `:fun` for a function that is a value, or `:apply`."
  @type call :: {atom(), text :: String.t()}

  # Ganglion's own modules. Other files in lib/ belong to somebody's robot.
  @own ["lib/bb.ex", "lib/{bb,ganglion,mix}/**/*.ex"]

  @doc """
  Returns the files of Ganglion's own modules in a checkout, sorted.

  A fork may have other files in `lib/`.
  """
  @spec own(Path.t()) :: [Path.t()]
  def own(root \\ ".") do
    for(pattern <- @own, file <- Path.wildcard(Path.join(root, pattern)), do: file)
    |> Enum.map(&Path.relative_to(&1, root))
    |> Enum.sort()
  end

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
      doctests: Enum.reverse(found.doctests),
      calls: calls(ast)
    }
  end

  # Functions that call a function by module, name and arguments.
  @appliers [:apply, :spawn, :spawn_link, :spawn_monitor]
  @tasks [:async, :start, :start_link]
  @libraries [:erlang, {:__aliases__, :any, [:Kernel]}, {:__aliases__, :any, [:Task]}]

  # Functions without arguments that could look like fields of a map.
  @unarmed [:inhibition, :options_schema, :param_schema, :content]

  defp calls(ast) do
    {_ast, calls} = Macro.prewalk(ast, [], &{&1, called(&1) ++ &2})
    Enum.sort_by(calls, &elem(&1, 1))
  end

  defp called({:&, meta, [{:/, _, [{{:., _, [target, name]}, _, []} = call, _arity]}]}),
    do: unnamed(target, name, call, meta)

  defp called({{:., meta, [_function]}, _, arguments} = call) when is_list(arguments),
    do: [{{:fun, Macro.to_string(call)}, meta[:line]}]

  defp called({{:., meta, [library, name]}, _, [module, _function, _arguments]} = call)
       when name in @appliers or name in @tasks do
    if bare(library) in @libraries, do: unnamed(module, :apply, call, meta), else: []
  end

  defp called({{:., meta, [target, name]}, call_meta, arguments} = call)
       when is_atom(name) and is_list(arguments) do
    field? = call_meta[:no_parens] == true and name not in @unarmed
    if field?, do: [], else: unnamed(target, name, call, meta)
  end

  defp called({name, meta, [module, _function, _arguments]} = call) when name in @appliers,
    do: unnamed(module, :apply, call, meta)

  defp called({:apply, meta, [_function, _arguments]} = call),
    do: [{{:apply, Macro.to_string(call)}, meta[:line]}]

  defp called(_node), do: []

  defp bare({:__aliases__, _, parts}), do: {:__aliases__, :any, parts}
  defp bare(other), do: other

  defp unnamed({:__aliases__, _, _}, _name, _call, _meta), do: []
  defp unnamed({:__MODULE__, _, _}, _name, _call, _meta), do: []
  defp unnamed(module, _name, _call, _meta) when is_atom(module), do: []
  defp unnamed(_target, name, call, meta), do: [{{name, Macro.to_string(call)}, meta[:line]}]

  # A node that has been read completely becomes nil, so that its parts are not read again.

  defp enter({definition, meta, [{:__aliases__, _, parts}, body]}, found)
       when definition in [:defmodule, :defprotocol] do
    module = Module.concat(List.wrap(List.first(found.outer)) ++ parts)
    found = %{found | modules: [module | found.modules], outer: [module | found.outer]}
    {{definition, meta, [nil, body]}, found}
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

  # An alias is valid until the end of its block.
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

  defp leave({definition, _, [nil, _]} = node, found)
       when definition in [:defmodule, :defprotocol] do
    [module | outer] = found.outer
    found = %{found | outer: outer}
    {node, if(outer == [], do: found, else: shorten(found, [module], []))}
  end

  defp leave({:do, _} = node, found), do: {node, %{found | aliases: tl(found.aliases)}}
  defp leave(node, found), do: {node, found}

  # The modules of an expression: one, several (`A.{B, C}`), or none that can be read.
  defp targets({:__aliases__, _, parts}, found), do: List.wrap(expand(parts, found))

  defp targets({{:., _, [{:__aliases__, _, parts}, :{}]}, _, members}, found) do
    for {:__aliases__, _, member} <- members, do: expand(parts ++ member, found)
  end

  defp targets(_other, _found), do: []

  defp expand([{:__MODULE__, _, _} | rest], %{outer: [module | _]}), do: concat([module | rest])

  defp expand([first | rest], found) when is_atom(first),
    do: concat([Map.get(hd(found.aliases), first, first) | rest])

  defp expand(_computed, _found), do: nil

  # As far as it is a literal: `Parser.unquote(name)` names Parser.
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

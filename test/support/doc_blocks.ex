defmodule BB.Test.DocBlocks do
  @moduledoc """
  Reads the fenced blocks of a Markdown document, and runs, saves or checks them as a reader
  would.

  The first word behind a fence is the block's language. A further word says where a reader types
  it, or the name of the file:

  | fence | the reader | the test |
  |---|---|---|
  | `elixir` | types it in `iex -S mix`, block after block | `run_elixir/3` |
  | `elixir console` | types it on a robot's console | `run_elixir/3` with the console's robot |
  | `elixir board` | the same, on a board | `check/2` |
  | `elixir config` | writes it into `config/` | `check/2`: evaluates it |
  | `elixir lib/rover.ex` | finds it in that file of the project of `bin/new` | `missing/2` |
  | `sh` | types it in a fresh clone, block after block | `run_sh/3` |
  | `sh board`, `nerves`, `fwup`, `root` | the same, with that equipment | `check/2` |
  | `sh long` | the same: tests and measurements | `check/2` |
  | `cpp talker.cpp`, `cmake CMakeLists.txt` | saves it | `save/2`; `run_sh/3` finds it |
  | `text`, or no word | reads it: output, signatures, drawings | nothing |
  """

  @enforce_keys [:document, :line, :language, :code]
  defstruct [:document, :line, :language, :code, words: []]

  @type t :: %__MODULE__{
          document: Path.t(),
          line: pos_integer(),
          language: String.t(),
          words: [String.t()],
          code: String.t()
        }

  @elsewhere ~w(board nerves fwup root long)
  @known %{
    "elixir" => ~w(board config console),
    "sh" => @elsewhere,
    "hex" => :any,
    "text" => [],
    "cmake" => :file,
    "cpp" => :file,
    "c" => :file,
    "python" => :file,
    "rust" => :file
  }

  @seconds 300

  @doc "Returns the blocks of a document, in order. The line is that of the first line of code."
  @spec read!(Path.t()) :: [t()]
  def read!(document), do: document |> File.read!() |> parse(document)

  @doc "Returns the blocks of a text."
  @spec parse(String.t(), Path.t()) :: [t()]
  def parse(text, document) do
    text
    |> String.split("\n")
    |> Enum.with_index(1)
    |> Enum.reduce({[], nil}, &line(&1, &2, document))
    |> finish(document)
  end

  defp line({text, number}, {blocks, nil}, document) do
    case Regex.run(~r/^( *)(```+|~~~+) *([^`]*)$/, text) do
      nil -> {blocks, nil}
      [_, indent, fence, info] -> {blocks, {indent, fence, open(info, number + 1, document), []}}
    end
  end

  defp line({text, _number}, {blocks, {indent, fence, block, lines}}, _document) do
    if String.trim(text) == fence do
      {[%{block | code: lines |> Enum.reverse() |> Enum.map_join(&(&1 <> "\n"))} | blocks], nil}
    else
      {blocks, {indent, fence, block, [String.replace_prefix(text, indent, "") | lines]}}
    end
  end

  defp open(info, line, document) do
    {language, words} = info |> String.split() |> List.pop_at(0, "text")
    %__MODULE__{document: document, line: line, language: language, words: words, code: ""}
  end

  defp finish({blocks, nil}, _document), do: Enum.reverse(blocks)

  defp finish({_blocks, {_, fence, block, _}}, document),
    do: raise("#{document}:#{block.line - 1}: the fence #{fence} is never closed")

  @doc "Returns the blocks of a language that have exactly these words."
  @spec select([t()], String.t(), [String.t()]) :: [t()]
  def select(blocks, language, words \\ []),
    do: Enum.filter(blocks, &(&1.language == language and &1.words == words))

  @doc "Returns the place of a block: file and line."
  @spec place(t()) :: String.t()
  def place(block), do: "#{block.document}:#{block.line}"

  # Running

  @doc """
  Runs Elixir blocks one after the other in a VM of their own, as IEx would.

  Each expression is evaluated after the one before, by `mix run` in `folder`. Returns the output
  and the exit status.

  Options: `env:` for the VM; `before:`, code that runs first; `mix:`, further arguments of `mix
  run`; `seconds:`, a timeout (300).
  """
  @spec run_elixir([t()], Path.t(), keyword()) :: {String.t(), non_neg_integer()}
  def run_elixir(blocks, folder, opts \\ []) do
    first = %__MODULE__{
      document: "before",
      line: 1,
      language: "elixir",
      code: opts[:before] || ""
    }

    texts = for block <- [first | blocks], do: {block.document, block.line, block.code}

    with_file(driver(texts), fn driver ->
      command(["mix", "run", "--no-compile"] ++ (opts[:mix] || []) ++ [driver], folder, opts)
    end)
  end

  defp driver(texts) do
    """
    blocks = #{inspect(texts, limit: :infinity, printable_limit: :infinity)}

    Enum.reduce(blocks, {[], Code.env_for_eval([])}, fn {file, line, code}, {binding, env} ->
      {:__block__, _, expressions} =
        case Code.string_to_quoted!(code, file: file, line: line) do
          {:__block__, meta, expressions} -> {:__block__, meta, expressions}
          expression -> {:__block__, [], [expression]}
        end

      Enum.reduce(expressions, {binding, %{env | file: file}}, fn expression, {binding, env} ->
        try do
          {_value, binding, env} = Code.eval_quoted_with_env(expression, binding, env)
          {binding, env}
        catch
          kind, reason ->
            {_node, first} = Macro.prewalk(expression, nil, fn
              {_, meta, _} = node, nil -> {node, meta[:line]}
              node, line -> {node, line}
            end)

            message = Exception.format(kind, reason, __STACKTRACE__)
            IO.puts(:stderr, "\#{file}:\#{first || line}: \#{message}")
            System.halt(1)
        end
      end)
    end)
    """
  end

  @doc """
  Runs shell blocks one after the other in one shell, in `folder`, until a command fails.

  Returns the output, with each command before its own output, and the exit status. Options:
  `env:` and `seconds:` as above.
  """
  @spec run_sh([t()], Path.t(), keyword()) :: {String.t(), non_neg_integer()}
  def run_sh(blocks, folder, opts \\ []) do
    script = Enum.map_join(blocks, "\n", &"# #{place(&1)}\n#{&1.code}")

    with_file("set -exo pipefail\n" <> script, fn file ->
      command(["bash", file], folder, opts)
    end)
  end

  @doc "Saves the blocks whose second word is a file's name, in `folder`."
  @spec save([t()], Path.t()) :: :ok
  def save(blocks, folder) do
    for %{words: [name]} = block <- blocks, @known[block.language] == :file do
      File.mkdir_p!(Path.dirname(Path.join(folder, name)))
      File.write!(Path.join(folder, name), block.code)
    end

    :ok
  end

  # A command that waits for an event that does not come fails by timeout.
  defp command(words, folder, opts) do
    bound = ["--kill-after=10", "#{opts[:seconds] || @seconds}"]
    options = [cd: folder, env: opts[:env] || [], stderr_to_stdout: true]
    System.cmd("timeout", bound ++ words, options)
  end

  defp with_file(text, fun) do
    file = Path.join(System.tmp_dir!(), BB.Test.Run.unique("blocks"))
    File.write!(file, text)

    try do
      fun.(file)
    after
      File.rm(file)
    end
  end

  @doc """
  Returns the lines of blocks that quote files of a project (`elixir lib/rover.ex`) and are not in
  these files.

  The lines must be in the order of the quotation. A quotation may leave lines out.
  """
  @spec missing([t()], Path.t()) :: [String.t()]
  def missing(blocks, project) do
    for %{language: "elixir", words: [name]} = block <- blocks, file?(name) do
      {block, lines(block.code), lines(File.read!(Path.join(project, name)))}
    end
    |> Enum.flat_map(fn {block, quoted, lines} ->
      for line <- not_found(quoted, lines), do: "#{place(block)}: #{line}"
    end)
  end

  defp file?(word), do: Path.extname(word) in ~w(.ex .exs)

  defp lines(text),
    do: text |> String.split("\n") |> Enum.map(&String.trim/1) |> Enum.reject(&(&1 == ""))

  defp not_found([], _lines), do: []

  defp not_found([line | rest] = quoted, lines) do
    case Enum.drop_while(lines, &(&1 != line)) do
      [] -> quoted
      [_found | lines] -> not_found(rest, lines)
    end
  end

  # Checking blocks that cannot be run

  @doc """
  Returns the errors of a block that show without running it, a sentence each.

  Commands of the project are looked up in `folder`, and their options in the output of `--help`.
  """
  @spec check(t(), Path.t()) :: [String.t()]
  def check(block, folder) do
    for sentence <- wrong_words(block) ++ wrong_code(block, folder),
        do: "#{place(block)}: #{sentence}"
  end

  defp wrong_words(%{language: language, words: words}) do
    case Map.fetch(@known, language) do
      :error ->
        ["no such language as #{language}; known: #{Enum.join(Map.keys(@known), " ")}"]

      {:ok, accepted} when is_atom(accepted) ->
        []

      {:ok, accepted} ->
        for word <- words -- accepted, not file?(word), do: "#{language} #{word} means nothing"
    end
  end

  defp wrong_code(%{language: "elixir", words: ["config"]} = block, _folder) do
    {found, diagnostics} = with_diagnostics(fn -> wrong_config(block) end)
    for(%{severity: :error, message: message} <- diagnostics, do: message) ++ found
  end

  defp wrong_code(%{language: "elixir"} = block, _folder) do
    case Code.string_to_quoted(block.code) do
      {:ok, _ast} -> []
      {:error, reason} -> [inspect(reason)]
    end
  end

  defp wrong_code(%{language: "sh"} = block, folder) do
    case System.cmd("bash", ["-n", "-c", block.code], stderr_to_stdout: true) do
      {_, 0} -> Enum.flat_map(commands(block.code), &wrong_command(&1, folder))
      {said, _} -> [said]
    end
  end

  defp wrong_code(_block, _folder), do: []

  defp wrong_config(block) do
    _ = Config.Reader.eval!(block.document, "import Config\n" <> block.code)
    unknown_modules(block.code)
  rescue
    error -> [Exception.message(error)]
  end

  # From Elixir 1.15 on an error of the compiler has no more to say than that it has said why.
  defp with_diagnostics(fun) do
    if function_exported?(Code, :with_diagnostics, 1),
      do: apply(Code, :with_diagnostics, [fun]),
      else: {fun.(), []}
  end

  defp unknown_modules(code) do
    {_ast, modules} =
      code
      |> Code.string_to_quoted!()
      |> Macro.prewalk([], fn
        {:__aliases__, _, [root | _] = parts} = node, found when root in [:BB, :Ganglion] ->
          {node, [Module.concat(parts) | found]}

        node, found ->
          {node, found}
      end)

    for module <- modules, not Code.ensure_loaded?(module), do: "there is no #{inspect(module)}"
  end

  @doc """
  Returns the commands of a shell text, each a list of words, without variables before them.
  """
  @spec commands(String.t()) :: [[String.t()]]
  def commands(code) do
    code
    |> String.replace("\\\n", " ")
    |> String.split(["\n", "&&", "||", ";", "|"])
    |> Enum.map(&words/1)
    |> Enum.reject(&(&1 == []))
  end

  defp words(line) do
    line
    |> String.replace(~r/(^|\s)#.*$/, "")
    |> String.split()
    |> Enum.drop_while(&(&1 =~ ~r/^\w+=/ or &1 in ~w(export until while do done exec)))
  end

  # A command of the project has to exist, and its help has to list the options.
  defp wrong_command(["ganglion" | arguments], folder),
    do: wrong_command(["bin/ganglion" | arguments], folder)

  defp wrong_command([command | arguments], folder) do
    path = Path.join(folder, command)

    cond do
      not ours?(command) -> []
      not executable?(path) -> ["#{command} is no command"]
      true -> unknown_to_help(path, command, arguments)
    end
  end

  defp ours?(command), do: command =~ ~r{^(\.?bin|\.ci|firmware/scripts|native)/}

  defp executable?(path) do
    case File.stat(path) do
      {:ok, %{type: :regular, mode: mode}} -> Bitwise.band(mode, 0o100) != 0
      _ -> false
    end
  end

  defp unknown_to_help(_path, ".ci/run", []), do: []

  defp unknown_to_help(path, command, arguments) do
    {help, status} = help(path, command, arguments)
    asked = for argument <- arguments, plain?(argument), do: hd(String.split(argument, "="))
    # For ganglion, the verb selected the help, and the other words are topics.
    asked = if command == "bin/ganglion", do: Enum.filter(asked, &(&1 =~ ~r/^-/)), else: asked

    if status == 0,
      do: for(word <- asked, not String.contains?(help, word), do: "#{command} has no #{word}"),
      else: ["#{command} --help ends with status #{status}"]
  end

  # Each verb of ganglion has a help of its own.
  defp help(path, "bin/ganglion", [verb | _]),
    do: System.cmd(path, [verb, "--help"], stderr_to_stdout: true)

  defp help(path, _command, _arguments), do: System.cmd(path, ["--help"], stderr_to_stdout: true)

  # An option, or a word that is no path.
  defp plain?(argument), do: argument =~ ~r/^--?[a-z-]+(=|$)/ or argument =~ ~r/^[a-z]+$/
end

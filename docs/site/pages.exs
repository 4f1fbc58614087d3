# Writes the source of the documentation's site: the documents of the repository at their paths,
# and a page for each module.
#
#     mix run --no-start docs/site/pages.exs FOLDER

defmodule Site.Links do
  @moduledoc "Makes links of names and paths."

  @doc "Links modules and functions in inline code; `here` is the page's path."
  def names(text, here, known) do
    outside_code(text, fn part ->
      Regex.replace(
        ~r/(?<![\[`\w])`((?:[ct]:)?)([A-Z][\w.]*?)((?:\.[a-z_]\w*[?!]?\/\d+)?)`(?![`\]])/,
        part,
        fn
          all, kind, module, function -> link(all, {kind, module, function}, here, known)
        end
      )
    end)
  end

  defp link(all, {kind, module, function}, here, known) do
    anchor = kind <> String.trim_leading(function, ".")

    case known do
      %{^module => anchors} when function == "" or is_map_key(anchors, anchor) ->
        fragment = if function == "", do: "", else: "#" <> URI.encode(anchor)

        href = "#{up(here)}elixir/#{module}.html#{fragment}"
        ~s(<a href="#{href}"><code>#{String.trim(all, "`")}</code></a>)

      _ ->
        all
    end
  end

  @doc "Links a module's own functions, types and callbacks in its text."
  def own(text, anchors) do
    outside_code(text, fn part ->
      Regex.replace(~r/(?<![\[`\w])`((?:[ct]:)?[a-z_]\w*[?!]?\/\d+)`(?![`\]])/, part, fn all,
                                                                                         name ->
        if is_map_key(anchors, name),
          do: ~s(<a href="##{URI.encode(name)}"><code>#{name}</code></a>),
          else: all
      end)
    end)
  end

  @doc "Returns the relative path from a page to the root of the site."
  def up(here), do: String.duplicate("../", length(Path.split(here)) - 1)

  @doc "Applies `fun` to the text outside of fenced and indented blocks."
  def outside_code(text, fun) do
    text
    |> String.split(~r/^ *```.*?^ *``` *$/ms, include_captures: true)
    |> Enum.map_join(fn part ->
      if part =~ ~r/\A *```/, do: part, else: outside_indented(part, fun)
    end)
  end

  # An indented block: lines indented by four, after an empty one.
  defp outside_indented(part, fun) do
    part
    |> String.split(~r/(?<=\n\n)(?: {4}.*\n|\n)+/, include_captures: true)
    |> Enum.map_join(fn text -> if text =~ ~r/\A\n* {4}/, do: text, else: fun.(text) end)
  end
end

defmodule Site.Module do
  @moduledoc "The page of one module, as Markdown."

  defstruct [:module, :name, :text, :entries]

  @kinds [
    {:type, "Types"},
    {:callback, "Callbacks"},
    {:macrocallback, "Callbacks"},
    {:macro, "Macros"},
    {:function, "Functions"}
  ]

  @doc "Returns the docs of a module, or `nil` without docs."
  def read(module) do
    case Code.fetch_docs(module) do
      {:docs_v1, _, _, _, %{"en" => text}, _, entries} ->
        entries = for {_, _, _, doc, _} = entry <- entries, doc != :hidden, do: entry
        %__MODULE__{module: module, name: inspect(module), text: text, entries: entries}

      _hidden_or_none ->
        nil
    end
  end

  @doc "Returns the anchors of its page."
  def anchors(page), do: Map.new(page.entries, fn {key, _, _, _, _} -> {anchor(key), true} end)

  @doc "Returns the page as Markdown."
  def render(page) do
    text = Site.Links.own(page.text, anchors(page))

    ["# #{page.name}\n\n", text, "\n\n", Enum.map(@kinds, &section(&1, page))]
    |> IO.iodata_to_binary()
  end

  @doc "Returns its first paragraph, for lists."
  def summary(page) do
    [first | _] = String.split(page.text, ~r/\n\s*\n/, parts: 2)
    first |> String.replace(~r/\s+/, " ") |> String.trim()
  end

  defp section({kind, title}, page) do
    case Enum.filter(page.entries, fn {{of, _, _}, _, _, _, _} -> of == kind end) do
      [] -> []
      entries -> ["## #{title}\n\n", Enum.map(entries, &entry(&1, page))]
    end
  end

  defp entry({{kind, name, arity} = key, _, signature, doc, _}, page) do
    [
      ~s(<a id="#{anchor(key)}"></a>\n\n),
      "### `#{heading(signature, name, arity)}`\n\n",
      specs(page.module, kind, name, arity),
      text(doc, anchors(page)),
      "\n\n"
    ]
  end

  defp heading([signature | _], _name, _arity), do: signature
  defp heading([], name, arity), do: "#{name}/#{arity}"

  defp text(%{"en" => text}, anchors), do: text |> deeper() |> Site.Links.own(anchors)
  defp text(_none, _anchors), do: ""

  # Moves headings below the heading of the function.
  defp deeper(text), do: Regex.replace(~r/^(##+) /m, text, "##\\1 ")

  defp anchor({:type, name, arity}), do: "t:#{name}/#{arity}"

  defp anchor({kind, name, arity}) when kind in [:callback, :macrocallback],
    do: "c:#{name}/#{arity}"

  defp anchor({_, name, arity}), do: "#{name}/#{arity}"

  defp specs(module, :type, name, arity) do
    {:ok, types} = Code.Typespec.fetch_types(module)

    for {kind, {^name, _, arguments} = type} <- types,
        length(arguments) == arity,
        do: shown(kind, type)
  end

  defp specs(module, kind, name, arity) when kind in [:callback, :macrocallback] do
    {:ok, callbacks} = Code.Typespec.fetch_callbacks(module)

    quoted(
      callbacks,
      kind,
      if(kind == :macrocallback, do: macro(name, arity), else: {name, arity}),
      name
    )
  end

  defp specs(module, kind, name, arity) do
    case Code.Typespec.fetch_specs(module) do
      {:ok, specs} ->
        quoted(
          specs,
          :spec,
          if(kind == :macro, do: macro(name, arity), else: {name, arity}),
          name
        )

      :error ->
        []
    end
  end

  defp macro(name, arity), do: {:"MACRO-#{name}", arity + 1}

  defp quoted(specs, kind, key, name) do
    for {^key, forms} <- specs,
        do:
          code(
            for form <- forms,
                do: "@#{kind} #{Macro.to_string(Code.Typespec.spec_to_quoted(name, form))}"
          )
  end

  # The definition of an opaque type is hidden.
  defp shown(:opaque, {name, _, arguments}),
    do: code(["@opaque #{name}#{if arguments == [], do: "", else: "(…)"}"])

  defp shown(kind, type),
    do: code(["@#{kind} #{Macro.to_string(Code.Typespec.type_to_quoted(type))}"])

  defp code(lines), do: ["```elixir\n", formatted(Enum.join(lines, "\n")), "\n```\n\n"]

  defp formatted(text), do: Code.format_string!(text, line_length: 90)
end

defmodule Site do
  @moduledoc "Writes all pages."

  alias Site.{Links, Module}

  @documents ~w(README.md CONTRIBUTING.md CHANGELOG.md firmware/README.md) ++
               ~w(docs/**/*.md native/*/README.md packages/*/README.md)

  # A page that is not in the table of contents.
  @alone "---\norphan: true\n---\n\n"

  def write(folder) do
    File.rm_rf!(folder)
    documents = @documents |> Enum.flat_map(&Path.wildcard/1) |> Enum.sort()
    modules = modules()
    known = Map.new(modules, &{&1.name, Module.anchors(&1)})

    sources =
      Map.new(
        modules,
        &{Path.relative_to_cwd(to_string(&1.module.module_info(:compile)[:source])), &1.name}
      )

    site = %{folder: folder, documents: documents, known: known, sources: sources}

    Enum.each(documents, &document(&1, site))

    for module <- modules,
        do:
          put(
            site,
            "elixir/#{module.name}.md",
            Links.names(Module.render(module), "elixir/page", known)
          )

    put(site, "elixir/index.md", modules_index(modules, known))
    put(site, "rust.md", crates())
    contents(documents, site)
  end

  defp modules do
    for module <- Application.spec(:ganglion, :modules), page = Module.read(module), do: page
  end

  # A document keeps its path; README.md is the index.
  defp place("README.md"), do: "index.md"
  defp place(path), do: path

  defp document(path, site) do
    text = File.read!(path) |> paths(path, site) |> Links.names(place(path), site.known)
    alone? = String.starts_with?(path, ["native/", "packages/"])
    put(site, place(path), [if(alone?, do: @alone, else: ""), text])
  end

  # The target of a link to a file of the repository: its page, the page of its module, a list of
  # the folder, or the file itself.
  defp paths(text, document, site) do
    Links.outside_code(text, fn part ->
      Regex.replace(~r/\]\(([^)\s]+)\)/, part, fn all, target ->
        path(all, target, document, site)
      end)
    end)
  end

  defp path(all, target, document, site) do
    {path, fragment} = split(target)

    full =
      document |> Path.dirname() |> Path.join(path) |> Path.expand() |> Path.relative_to_cwd()

    cond do
      target =~ ~r/^([a-z]+:|#)/ -> all
      full in site.documents -> to(document, place(full), fragment)
      is_map_key(site.sources, full) -> to(document, "elixir/#{site.sources[full]}.md", "")
      File.dir?(full) -> listing(document, full, site)
      File.regular?(full) -> copy(document, full, site)
      true -> raise "#{document}: the link #{target} is broken"
    end
  end

  defp split(target) do
    case String.split(target, "#", parts: 2) do
      [path] -> {path, ""}
      [path, fragment] -> {path, "#" <> fragment}
    end
  end

  defp to(document, path, fragment), do: "](#{Links.up(place(document))}#{path}#{fragment})"

  defp copy(document, file, site) do
    File.mkdir_p!(Path.dirname(Path.join(site.folder, file)))
    File.cp!(file, Path.join(site.folder, file))
    to(document, file, "")
  end

  # The page of a folder is its README, or else a list of its files.
  defp listing(document, folder, site) do
    readme = Path.join(folder, "README.md")
    if readme in site.documents, do: to(document, readme, ""), else: list(document, folder, site)
  end

  defp list(document, folder, site) do
    page = Path.join(folder, "index.md")

    files =
      for file <- Enum.sort(Path.wildcard(folder <> "/*")), File.regular?(file) do
        unless file in site.documents, do: copy(document, file, site)
        "- [#{Path.basename(file)}](#{Path.basename(file)})\n"
      end

    put(site, page, [@alone, "# #{folder}\n\n", files])
    to(document, page, "")
  end

  defp modules_index(modules, known) do
    rows = for module <- modules, do: "- `#{module.name}`: #{Module.summary(module)}\n"
    names = Enum.map(modules, &{&1.name, &1.name})

    [
      "# Elixir modules\n\n",
      Links.names(IO.iodata_to_binary(rows), "elixir/index", known),
      "\n",
      toctree(nil, names)
    ]
  end

  defp crates do
    rows =
      for toml <- Path.wildcard("native/*/Cargo.toml"),
          text = File.read!(toml),
          [_, package] <- [Regex.run(~r/^name = "(\w+)"/m, text)],
          crate = crate(toml, package),
          File.exists?("_build/cargo/doc/#{crate}/index.html"),
          link = ~s(<a href="rust/#{crate}/index.html"><code>#{crate}</code></a>),
          do: "- #{link}: #{first_line(toml)}\n"

    ["# Rust crates\n\nBuilt by rustdoc.\n\n", rows]
  end

  defp crate(toml, package) do
    case Regex.run(~r/^\[lib\][^\[]*?^name = "(\w+)"/ms, File.read!(toml)) do
      [_, name] -> name
      nil -> package
    end
  end

  # The first line of the crate's documentation.
  defp first_line(toml) do
    sources = for name <- ~w(lib main), do: Path.join(Path.dirname(toml), "src/#{name}.rs")
    source = Enum.find(sources, &File.exists?/1)
    [_, line] = Regex.run(~r/^\/\/! (.*)$/m, File.read!(source))
    line
  end

  defp contents(documents, site) do
    groups = [
      {"Guides", in_folder(documents, "docs/guides")},
      {"Background", in_folder(documents, "docs") ++ ["CONTRIBUTING.md", "CHANGELOG.md"]},
      {"Boards", ["firmware/README.md"]},
      {"Reference", ["elixir/index.md", "rust.md"]},
      {"Decisions", in_folder(documents, "docs/decisions")}
    ]

    trees =
      for {caption, pages} <- groups,
          do: toctree(caption, Enum.map(pages, &{nil, Path.rootname(&1)}))

    index = Path.join(site.folder, "index.md")
    File.write!(index, [File.read!(index), "\n", trees])
  end

  defp in_folder(documents, folder), do: Enum.filter(documents, &(Path.dirname(&1) == folder))

  defp toctree(caption, pages) do
    [
      "```{toctree}\n:hidden:\n",
      if(caption, do: ":caption: #{caption}\n", else: ""),
      "\n",
      for({title, page} <- pages, do: if(title, do: "#{title} <#{page}>\n", else: "#{page}\n")),
      "```\n\n"
    ]
  end

  defp put(site, path, text) do
    file = Path.join(site.folder, path)
    File.mkdir_p!(Path.dirname(file))
    File.write!(file, text)
  end
end

[folder] = System.argv()
Site.write(folder)

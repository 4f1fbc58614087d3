defmodule Ganglion.New.Templates do
  @moduledoc """
  Renders the files of a new project.

  `Ganglion.New` writes them. Files that are equal in every project are copies of this
  repository's own; the others are templates in `lib/mix/tasks/ganglion.new/`. Both are read at
  compile time.

      where = [from: File.cwd!(), checkout: File.cwd!()]
      {:ok, options} = Ganglion.New.Options.parse(["../rover"], where)
      for {path, _text, _executable?} <- Ganglion.New.Templates.files(options), do: path
  """

  alias Ganglion.New.{Dependency, Options}

  @folder "lib/mix/tasks/ganglion.new"

  # {path in the project, template, condition}. In a path, `app` stands for the application's
  # name. Conditions: :always, :boards (a board is a target), :native, :rust, :python.
  @templates [
    {".formatter.exs", "formatter.exs.eex", :always},
    {".gitignore", "gitignore.eex", :always},
    {"README.md", "README.md.eex", :always},
    {"mix.exs", "mix.exs.eex", :always},
    {"config/config.exs", "config/config.exs.eex", :always},
    {"config/host.exs", "config/host.exs.eex", :always},
    {"config/target.exs", "config/target.exs.eex", :boards},
    {"lib/app.ex", "lib/robot.ex.eex", :always},
    {"lib/app/temperature.ex", "lib/temperature.ex.eex", :always},
    {"lib/app/thermometer.ex", "lib/thermometer.ex.eex", :always},
    {"lib/app/simulated_thermometer.ex", "lib/simulated_thermometer.ex.eex", :always},
    {"lib/app/ranger.ex", "lib/ranger.ex.eex", :native},
    {"test/test_helper.exs", "test/test_helper.exs.eex", :always},
    {"test/app_test.exs", "test/robot_test.exs.eex", :always},
    {"test/app/thermometer_test.exs", "test/thermometer_test.exs.eex", :always},
    {"bin/environment", "bin/environment.eex", :always},
    {"bin/setup", "bin/setup.eex", :always},
    {"bin/demo", "bin/demo.eex", :always},
    {"bin/test", "bin/test.eex", :always},
    {"firmware/scripts/burn", "firmware/script.eex", :boards},
    {"firmware/scripts/keys", "firmware/script.eex", :boards},
    {"firmware/scripts/sign", "firmware/script.eex", :boards},
    {"firmware/scripts/upload", "firmware/script.eex", :boards},
    {"native/Cargo.toml", "native/Cargo.toml.eex", :rust},
    {"native/ranger/Cargo.toml", "native/ranger/Cargo.toml.eex", :rust},
    {"native/ranger/src/main.rs", "native/ranger/src/main.rs.eex", :rust},
    {"native/ranger", "native/ranger.sh.eex", :python},
    {"native/ranger.py", "native/ranger.py.eex", :python}
  ]

  # {path in the repository and in the project, condition}.
  @shared [
    {"rel/vm.args.eex", :boards},
    {"rootfs_overlay/etc/iex.exs", :boards},
    {"firmware/provisioning.conf", :boards}
  ]

  @executable ~r{\Abin/(?!environment)|\Afirmware/scripts/|\Anative/ranger\z}

  for file <- [".formatter.exs" | Enum.map(@shared, &elem(&1, 0))], do: @external_resource(file)
  for {_, template, _} <- @templates, do: @external_resource(Path.join(@folder, template))

  @texts Map.new(@templates, fn {_, template, _} ->
           {template, File.read!(Path.join(@folder, template))}
         end)
  @copies for {file, condition} <- @shared, do: {file, File.read!(file), condition}

  # The project's own formatter imports the same list.
  @locals_without_parens Code.eval_file(".formatter.exs")
                         |> elem(0)
                         |> Keyword.fetch!(:locals_without_parens)

  @typedoc "A file of the project: its path, its text, and whether it is executable."
  @type file :: {Path.t(), String.t(), executable? :: boolean()}

  @doc "Returns all files of a project with these options."
  @spec files(Options.t()) :: [file()]
  def files(options) do
    assigns = assigns(options)

    rendered =
      for {path, template, condition} <- @templates, applies?(condition, options) do
        path = String.replace(path, ~r{(?<=/)app(?=[/._])}, options.app)
        {path, render(path, @texts[template], assigns)}
      end

    copied =
      for {path, text, condition} <- @copies, applies?(condition, options), do: {path, text}

    for {path, text} <- rendered ++ copied, do: {path, text, path =~ @executable}
  end

  defp applies?(:always, _options), do: true
  defp applies?(:boards, options), do: options.targets != []
  defp applies?(:native, options), do: options.native != :none
  defp applies?(kind, options), do: options.native == kind

  defp assigns(options) do
    folder = Dependency.folder(options.dependency)

    [
      app: options.app,
      module: options.module,
      native: options.native,
      targets: options.targets,
      boards: Keyword.take(Options.boards(), options.targets),
      git?: match?({:git, _url, _ref}, options.dependency),
      dependency: Dependency.entry(options.dependency),
      # Ganglion's folder, relative to the project and to its native/.
      ganglion: folder,
      from_native: if(Path.type(folder) == :absolute, do: folder, else: Path.join("..", folder))
    ]
  end

  defp render(path, template, assigns) do
    # Mix has loaded EEx. A call by its name would make it a dependency of the application.
    eex = EEx
    text = template |> join_tags() |> eex.eval_string(assigns: [{:file, path} | assigns])
    if Path.extname(path) in [".ex", ".exs"], do: format(text), else: text
  end

  # Removes the line break after a line that has nothing but a tag.
  defp join_tags(template) do
    String.replace(
      template,
      ~r/^ *(<%=? (?:if|for) [^\n]*(?:do|->) %>|<% else %>|<% end %>)\n/m,
      "\\1"
    )
  end

  # Long names change where lines break. Elixir 1.20 breaks some lines in a second pass only.
  defp format(text), do: text |> format_once() |> format_once()

  defp format_once(text) do
    formatted = Code.format_string!(text, locals_without_parens: @locals_without_parens)
    IO.iodata_to_binary([formatted, "\n"])
  end
end

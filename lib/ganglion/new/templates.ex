defmodule Ganglion.New.Templates do
  @moduledoc """
  The files of a new project: which there are, and their text.

  What the repository's own robot has in the same words is the repository's own file. The rest are the templates below
  `lib/mix/tasks/ganglion.new/`. Both are read when this module is compiled.
  """

  alias Ganglion.New.{Options, Source}

  @folder "lib/mix/tasks/ganglion.new"

  # Where in the project, from which file, and when: always, or with :boards, :rust or :python. `app` stands for the application.
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

  # The same files as the repository's own robot has.
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

  # The words that stand without parentheses, as the project's own formatter gets them.
  @words Code.eval_file(".formatter.exs") |> elem(0) |> Keyword.fetch!(:locals_without_parens)

  @typedoc "A file of the project: its path, its text, and whether it can be run."
  @type file :: {Path.t(), String.t(), executable? :: boolean()}

  @doc "All files of a project with these options."
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
    folder = Source.folder(options.source)

    [
      app: options.app,
      module: options.module,
      native: options.native,
      targets: options.targets,
      boards: Keyword.take(Options.boards(), options.targets),
      source: options.source,
      dependency: Source.dependency(options.source),
      # The folder as seen from the project's, and from its native/.
      ganglion: folder,
      from_native: if(Path.type(folder) == :absolute, do: folder, else: Path.join("..", folder))
    ]
  end

  defp render(path, template, assigns) do
    # Mix has loaded it. Called by its name it would be a dependency of what runs.
    eex = EEx
    text = template |> join_tags() |> eex.eval_string(assigns: [{:file, path} | assigns])
    if Path.extname(path) in [".ex", ".exs"], do: format(text), else: text
  end

  # A line that is a tag alone is no line of the file.
  defp join_tags(template) do
    String.replace(
      template,
      ~r/^ *(<%=? (?:if|for) [^\n]*(?:do|->) %>|<% else %>|<% end %>)\n/m,
      "\\1"
    )
  end

  # A long name changes where lines break. Elixir 1.20 breaks some of them in a second pass.
  defp format(text), do: text |> format_once() |> format_once()

  defp format_once(text),
    do: IO.iodata_to_binary([Code.format_string!(text, locals_without_parens: @words), "\n"])
end

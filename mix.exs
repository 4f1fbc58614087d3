defmodule Ganglion.MixProject do
  use Mix.Project

  @app :ganglion
  @version "0.1.0"

  def project do
    [
      app: @app,
      version: @version,
      elixir: "~> 1.14",
      compilers: Mix.compilers() ++ [:cargo],
      cargo: cargo(),
      aliases: ["compile.cargo": [&load_compiler/1, "compile.cargo"]],
      elixirc_paths: elixirc_paths(Mix.env()),
      start_permanent: Mix.env() == :prod,
      deps: deps(Mix.target())
    ] ++ for_target(Mix.target())
  end

  def application do
    [
      mod: {Ganglion.Application, []},
      # SASL has the alarm handler. The releases list the other applications of an image.
      extra_applications: [:logger, :sasl] ++ test_applications(Mix.env())
    ]
  end

  # `config :ganglion, programs: [...]` selects which of `programs:` are built.
  defp cargo do
    [
      path: "native",
      nif: ["conduit_ring_nif", "linux_bus_nif"],
      always: ["process_guard"],
      programs: ["camera", "ganglion", "vision_tags"],
      locked: true
    ]
  end

  # The compiler :cargo is a module of this project. `mix compile.cargo` in a new build folder
  # runs before Mix has compiled it.
  defp load_compiler(_args) do
    unless Code.ensure_loaded?(Mix.Tasks.Compile.Cargo) do
      parts = Path.wildcard("lib/mix/tasks/compile.cargo/*.ex")
      Enum.each(parts ++ ["lib/mix/tasks/compile.cargo.ex"], &Code.require_file/1)
    end
  end

  defp test_applications(:test), do: [:proper, :ssh]
  defp test_applications(_env), do: []

  if Version.match?(System.version(), ">= 1.15.0") do
    def cli, do: [preferred_targets: [run: :host, test: :host]]
  end

  defp elixirc_paths(:test), do: ["lib", "test/support"]
  defp elixirc_paths(_env), do: ["lib"]

  defp for_target(:host), do: [releases: [{@app, host_release()}]]

  defp for_target(_target),
    do: [archives: [nerves_bootstrap: "~> 1.16"], releases: [{@app, release()}]]

  # rel/ has the templates for boards, where heart watches the VM. The host uses Mix's templates.
  defp host_release do
    [overwrite: true, rel_templates_path: "rel/host", applications: [runtime_tools: :permanent]]
  end

  defp release do
    [
      overwrite: true,
      applications: [runtime_tools: :permanent, ssh: :permanent],
      cookie: "#{@app}_cookie",
      include_erts: &Nerves.Release.erts/0,
      steps: [&Nerves.Release.init/1, :assemble],
      strip_beams: Mix.env() == :prod or [keep: ["Docs"]]
    ]
  end

  # Mix resolves every dependency before it filters by `targets:`. Without Hex only an empty list
  # works.
  defp deps(:host), do: []

  defp deps(_target) do
    [
      {:shoehorn, "~> 0.9.3"},
      {:ring_logger, "~> 0.11.6"},
      {:toolshed, "~> 0.5"},
      {:rustler, "~> 0.38", runtime: false},
      {:nerves_runtime, "~> 0.13.13"},
      {:nerves_pack, "~> 0.7.2"},
      {:vintage_net, "~> 0.13.13"},
      {:circuits_i2c, "~> 2.1"},
      {:circuits_gpio, "~> 2.3"}
    ] ++ if(Mix.Project.get() in [nil, __MODULE__], do: image(), else: [])
  end

  # The dependencies that build an image. A project that depends on this one lists its own.
  defp image do
    {boards, _binding} = Code.eval_file("config/boards.exs", __DIR__)

    systems =
      for {board, facts} <- boards,
          do: {:"nerves_system_#{board}", facts[:system], runtime: false, targets: board}

    [{:nerves, "~> 1.15", runtime: false} | systems]
  end
end

defmodule Mix.Tasks.Compile.Cargo.Crates do
  @moduledoc """
  Checks the options `cargo:` of a project, and determines which crates to build.

  `Mix.Tasks.Compile.Cargo` uses it. It reads nothing but whether the workspace exists.

      {:ok, crates} = Mix.Tasks.Compile.Cargo.Crates.new(:rover, [programs: ["detector"]], nil)
      Mix.Tasks.Compile.Cargo.Crates.files(crates)
      #=> [{"detector", "bin/detector"}]
  """

  @enforce_keys [:name, :path]
  defstruct [:name, :path, nifs: [], packages: [], programs: [], locked?: false]

  @typedoc "The crates to build. `packages` are the packages of all NIFs and programs."
  @type t :: %__MODULE__{
          name: String.t(),
          path: Path.t(),
          nifs: [String.t()],
          packages: [String.t()],
          programs: [String.t()],
          locked?: boolean()
        }

  @keys [:path, :programs, :always, :nif, :locked]
  @example ~s(cargo: [path: "native", programs: ["my_program"]])

  @doc """
  Returns the crates of the application `app` with the options `given`.

  `selected` lists the programs to build, and `nil` selects all. Invalid options return
  `{:error, sentence}`.
  """
  @spec new(atom(), term(), term()) :: {:ok, t()} | {:error, String.t()}
  def new(app, given, selected) do
    with {:ok, options} <- options(app, given),
         :ok <- check_workspace(app, options[:path]),
         {:ok, chosen} <- select(app, options[:programs], selected) do
      programs = Enum.map(options[:always] ++ chosen, &pair/1)
      nifs = List.wrap(options[:nif])

      {:ok,
       %__MODULE__{
         name: to_string(app),
         path: Path.expand(options[:path]),
         nifs: nifs,
         packages: Enum.uniq(nifs ++ Enum.map(programs, &elem(&1, 0))),
         programs: Enum.map(programs, &elem(&1, 1)),
         locked?: options[:locked]
       }}
    end
  end

  @doc "Returns the files to install, as `{name in cargo's folder, name in priv}`."
  @spec files(t()) :: [{String.t(), String.t()}]
  def files(%__MODULE__{} = crates) do
    nifs =
      for nif <- crates.nifs,
          library = String.replace(nif, "-", "_"),
          do: {"lib#{library}.so", "#{library}.so"}

    nifs ++ for program <- crates.programs, do: {program, Path.join("bin", program)}
  end

  defp options(app, nil) do
    {:error,
     "#{app} has the compiler :cargo and no options for it: add `#{@example}` to project/0 in " <>
       "mix.exs, or remove :cargo from `compilers:`"}
  end

  defp options(app, given) do
    options = [path: "native", programs: [], always: [], nif: nil, locked: false]

    cond do
      not Keyword.keyword?(given) -> format_invalid(app, "keywords as in `#{@example}`", given)
      (unknown = Keyword.keys(given) -- @keys) != [] -> format_invalid(app, known_keys(), unknown)
      expected = Enum.find_value(given, &expected/1) -> format_invalid(app, expected, given)
      true -> {:ok, Keyword.merge(options, given)}
    end
  end

  defp known_keys, do: "the keys " <> Enum.map_join(@keys, ", ", &inspect/1)

  defp format_invalid(app, expected, got) do
    {:error,
     "invalid value for cargo: in the mix.exs of #{app}: expected #{expected}, " <>
       "got: #{inspect(got)}"}
  end

  defp expected({:path, path}) when is_binary(path) and path != "", do: nil
  defp expected({:path, _path}), do: ~s(path: a folder such as "native")

  defp expected({:nif, nif}) do
    unless nif |> List.wrap() |> Enum.all?(&name?/1),
      do: "nif: nil or the name of a package, or a list of names"
  end

  defp expected({:locked, locked}) when is_boolean(locked), do: nil
  defp expected({:locked, _locked}), do: "locked: true or false"

  defp expected({key, programs}) do
    unless is_list(programs) and Enum.all?(programs, &program?/1),
      do: ~s(#{key}: a list of names such as "detector" or {"package", "detector"})
  end

  defp program?({package, program}), do: name?(package) and name?(program)
  defp program?(program), do: name?(program)
  defp name?(name), do: is_binary(name) and name =~ ~r/\A[A-Za-z0-9_-]+\z/

  defp check_workspace(app, path) do
    if File.regular?(Path.join(path, "Cargo.toml")) do
      :ok
    else
      {:error,
       "#{app} has the compiler :cargo but no #{Path.join(path, "Cargo.toml")}: put the crate " <>
         "or workspace there, correct `path:` in `cargo:`, or remove :cargo from `compilers:` " <>
         "in mix.exs"}
    end
  end

  defp select(_app, programs, nil), do: {:ok, programs}

  defp select(app, programs, selected) do
    names = Enum.map(programs, &elem(pair(&1), 1))

    unknown =
      if is_list(selected), do: Enum.reject(selected, &(name(&1) in names)), else: selected

    if unknown == [] do
      selected = Enum.map(selected, &name/1)
      {:ok, Enum.filter(programs, &(elem(pair(&1), 1) in selected))}
    else
      {:error,
       "config #{inspect(app)}, programs: expected a list of #{format_names(names)}, " <>
         "got: #{inspect(unknown)}; correct it, or remove it to build all programs"}
    end
  end

  defp name(name) when is_atom(name) or is_binary(name), do: to_string(name)
  defp name(_other), do: nil

  defp format_names([]), do: "no programs"
  defp format_names(names), do: Enum.map_join(names, ", ", &inspect(String.to_atom(&1)))

  defp pair({package, program}), do: {package, program}
  defp pair(program), do: {program, program}
end

defmodule Mix.Tasks.Compile.Cargo.Crates do
  @moduledoc """
  What the Mix compiler is to build: the options `cargo:` of a project, and what the configuration
  of its application asks for. Pure but for looking whether the workspace is there.
  """

  @enforce_keys [:name, :path]
  defstruct [:name, :path, nifs: [], packages: [], programs: [], locked?: false]

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
  The crates of the application `app` with the options `given`, of whose programs those `asked` for
  are built; `nil` asks for all. A mistake is `{:error, sentence}`.
  """
  @spec new(atom(), term(), term()) :: {:ok, t()} | {:error, String.t()}
  def new(app, given, asked) do
    with {:ok, options} <- options(app, given),
         :ok <- there(app, options[:path]),
         {:ok, chosen} <- choose(app, options[:programs], asked) do
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

  @doc "The files to install: `{name in cargo's folder, name in priv}`."
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
       "mix.exs, or take :cargo out of `compilers:`"}
  end

  defp options(app, given) do
    options = [path: "native", programs: [], always: [], nif: nil, locked: false]

    cond do
      not Keyword.keyword?(given) -> refuse(app, "keywords as in `#{@example}`", given)
      (unknown = Keyword.keys(given) -- @keys) != [] -> refuse(app, accepted(), unknown)
      mistake = Enum.find_value(given, &mistake/1) -> refuse(app, mistake, given)
      true -> {:ok, Keyword.merge(options, given)}
    end
  end

  defp accepted, do: "the keys " <> Enum.map_join(@keys, ", ", &inspect/1)

  defp refuse(app, expected, got) do
    {:error,
     "cargo: in the mix.exs of #{app}: expected #{expected}, got: #{inspect(got)}; correct it there"}
  end

  defp mistake({:path, path}) when is_binary(path) and path != "", do: nil
  defp mistake({:path, _path}), do: ~s(path: a folder such as "native")

  defp mistake({:nif, nif}) do
    unless nif |> List.wrap() |> Enum.all?(&name?/1),
      do: "nif: nil or the name of a package, or a list of names"
  end

  defp mistake({:locked, locked}) when is_boolean(locked), do: nil
  defp mistake({:locked, _locked}), do: "locked: true or false"

  defp mistake({key, programs}) do
    unless is_list(programs) and Enum.all?(programs, &program?/1),
      do: ~s(#{key}: a list of names such as "detector" or {"package", "detector"})
  end

  defp program?({package, program}), do: name?(package) and name?(program)
  defp program?(program), do: name?(program)
  defp name?(name), do: is_binary(name) and name =~ ~r/\A[A-Za-z0-9_-]+\z/

  defp there(app, path) do
    if File.regular?(Path.join(path, "Cargo.toml")) do
      :ok
    else
      {:error,
       "#{app} has the compiler :cargo, and there is no #{Path.join(path, "Cargo.toml")}: put the " <>
         "crate or workspace there, correct `path:` in `cargo:`, or take :cargo out of " <>
         "`compilers:` in mix.exs"}
    end
  end

  defp choose(_app, programs, nil), do: {:ok, programs}

  defp choose(app, programs, asked) do
    names = Enum.map(programs, &elem(pair(&1), 1))
    strange = if is_list(asked), do: Enum.reject(asked, &(named(&1) in names)), else: asked

    if strange == [] do
      asked = Enum.map(asked, &named/1)
      {:ok, Enum.filter(programs, &(elem(pair(&1), 1) in asked))}
    else
      {:error,
       "config #{inspect(app)}, programs: expected a list out of #{listed(names)}, " <>
         "got: #{inspect(strange)}; correct it, or remove it to have all of them"}
    end
  end

  defp named(name) when is_atom(name) or is_binary(name), do: to_string(name)
  defp named(_other), do: nil

  defp listed([]), do: "no programs"
  defp listed(names), do: Enum.map_join(names, ", ", &inspect(String.to_atom(&1)))

  defp pair({package, program}), do: {package, program}
  defp pair(program), do: {program, program}
end

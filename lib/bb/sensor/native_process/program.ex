defmodule BB.Sensor.NativeProcess.Program do
  @moduledoc """
  Finds the program of a native process: the file that the option `program:` names.

  `BB.Sensor.NativeProcess` looks it up at each start. A robot's own code may use it to check that
  a program is installed.

      iex> {:ok, path} = BB.Sensor.NativeProcess.Program.find({:ganglion, "process_guard"})
      iex> Path.basename(path)
      "process_guard"
      iex> BB.Sensor.NativeProcess.Program.find({:rovr, "detector"})
      {:error, {:unknown_application, :rovr}}
  """

  import Bitwise

  # Ganglion's programs that the project does not build. Without a configuration it builds all.
  @not_built (case Application.compile_env(:ganglion, :programs) do
                nil ->
                  []

                names ->
                  ~w(camera ganglion vision_tags) -- for(name <- List.wrap(names), do: "#{name}")
              end)

  @typedoc "The place of a program: in the `priv/bin` of an application, or its path or name."
  @type place :: {app :: atom(), name :: String.t()} | String.t()

  @typedoc "A place, or a function that returns one."
  @type t :: place() | (() -> place()) | mfa()

  @typedoc """
  Why no program can be run:

    * `{:program_not_found, place}` - no file is at that place
    * `{:not_executable, path}` - the file is not executable
    * `{:unknown_application, app}` - the project has no such application
    * `{:no_program, text}` - the function returned no place, or failed
  """
  @type reason ::
          {:program_not_found, place()}
          | {:not_executable, Path.t()}
          | {:unknown_application, atom()}
          | {:no_program, String.t()}

  @expected ~s(a name, a path, {:my_app, "name"}, or a function of no arguments that returns one)

  @doc false
  def check(program) do
    if place?(program) or function?(program),
      do: {:ok, program},
      else: {:error, "expected #{@expected}, got: #{inspect(program)}"}
  end

  defp place?({app, name}), do: is_atom(app) and app not in [nil, true, false] and name?(name)
  defp place?(name), do: name?(name)

  defp name?(name), do: is_binary(name) and name != "" and not String.contains?(name, <<0>>)

  defp function?({module, function, arguments}),
    do: is_atom(module) and is_atom(function) and is_list(arguments)

  defp function?(function), do: is_function(function, 0)

  @doc "Returns the path of a program that can be run."
  @spec find(t()) :: {:ok, Path.t()} | {:error, reason()}
  def find({module, function, arguments}),
    do: find_returned(fn -> apply(module, function, arguments) end)

  def find(function) when is_function(function, 0), do: find_returned(function)
  def find(place), do: look_up(place)

  defp find_returned(function) do
    place = function.()

    if place?(place),
      do: look_up(place),
      else: {:error, {:no_program, "returned #{inspect(place)}, expected #{@expected}"}}
  catch
    kind, reason ->
      {:error, {:no_program, "failed: " <> Exception.format_banner(kind, reason, __STACKTRACE__)}}
  end

  defp look_up({app, name}) do
    case :code.lib_dir(app) do
      {:error, :bad_name} -> {:error, {:unknown_application, app}}
      folder -> first_executable([Path.join([folder, "priv", "bin", name])], {app, name})
    end
  end

  # A name with a slash is a path, as for a shell.
  defp look_up(name) do
    if String.contains?(name, "/"),
      do: first_executable([name], name),
      else:
        first_executable([shipped(name) | Enum.map(search_path(), &Path.join(&1, name))], name)
  end

  defp search_path, do: "PATH" |> System.get_env("") |> String.split(":", trim: true)

  # The first of several files that is executable, as for a shell.
  defp first_executable(candidates, place) do
    files = Enum.filter(candidates, &File.regular?/1)

    case {Enum.find(files, &executable?/1), files} do
      {nil, []} -> {:error, {:program_not_found, place}}
      {nil, [file | _]} -> {:error, {:not_executable, Path.expand(file)}}
      {program, _files} -> {:ok, program}
    end
  end

  defp executable?(file), do: (File.stat!(file).mode &&& 0o111) != 0

  @doc "Returns the path of a program that ships with Ganglion, even when it was not built."
  @spec shipped(String.t()) :: Path.t()
  def shipped(name), do: Application.app_dir(:ganglion, ["priv", "bin", name])

  @doc """
  Formats a reason as a sentence that says what to do.

      iex> BB.Sensor.NativeProcess.Program.explain({:not_executable, "/opt/rover/detect.py"})
      "/opt/rover/detect.py is not executable: run chmod +x /opt/rover/detect.py"
      iex> BB.Sensor.NativeProcess.Program.explain({:unknown_application, :rovr})
      "application :rovr is unknown: correct its name in `program:`, or add it to the project"
  """
  @spec explain(reason()) :: String.t()
  def explain({:program_not_found, {app, name}}) do
    "program #{name} is not in the priv/bin of #{inspect(app)}: build it there, or correct " <>
      "its name in `program:`" <> not_built(app, name)
  end

  def explain({:program_not_found, name}) do
    if String.contains?(name, "/"),
      do: "program #{name} does not exist: correct its path in `program:`, or put it there",
      else:
        "program #{name} is neither in priv/bin nor in PATH" <>
          not_built(:ganglion, name)
  end

  def explain({:not_executable, path}),
    do: "#{path} is not executable: run chmod +x #{path}"

  def explain({:unknown_application, app}) do
    "application #{inspect(app)} is unknown: correct its name in `program:`, or add it to " <>
      "the project"
  end

  def explain({:no_program, text}), do: "the function in `program:` #{text}"

  defp not_built(app, name) do
    if app == :ganglion and Enum.member?(@not_built, name),
      do: ". It is built when `config :ganglion, programs:` has #{inspect(String.to_atom(name))}",
      else: ""
  end
end

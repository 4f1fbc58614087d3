defmodule BB.Sensor.NativeProcess.Program do
  @moduledoc """
  Where the program of a native process is: what `program:` means, looked up at each start.

      iex> {:ok, path} = BB.Sensor.NativeProcess.Program.find({:ganglion, "process_guard"})
      iex> Path.basename(path)
      "process_guard"
      iex> BB.Sensor.NativeProcess.Program.find({:rovr, "detector"})
      {:error, {:unknown_application, :rovr}}
  """

  import Bitwise

  # Those of Ganglion's that the project has not asked for; without a configuration it has all.
  @unasked (case Application.compile_env(:ganglion, :programs) do
              nil ->
                []

              names ->
                ~w(camera ganglion vision_tags) -- for(name <- List.wrap(names), do: "#{name}")
            end)

  @typedoc "Where a program is: in the `priv/bin` of an application; or its path, or its name."
  @type place :: {app :: atom(), name :: String.t()} | String.t()

  @typedoc "A place, or a function that gives one."
  @type t :: place() | (() -> place()) | mfa()

  @typedoc """
  Why there is nothing to run:

    * `{:program_not_found, place}` - it is not where it was looked for
    * `{:not_executable, path}` - there is such a file, and it may not be run
    * `{:unknown_application, app}` - nothing here has that application
    * `{:no_program, text}` - the function gave no place, or failed
  """
  @type reason ::
          {:program_not_found, place()}
          | {:not_executable, Path.t()}
          | {:unknown_application, atom()}
          | {:no_program, String.t()}

  @expected ~s(a name, a path, {:my_app, "name"}, or a function without arguments that gives one)

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

  @doc "The path of a program that can be run."
  @spec find(t()) :: {:ok, Path.t()} | {:error, reason()}
  def find({module, function, arguments}), do: given(fn -> apply(module, function, arguments) end)
  def find(function) when is_function(function, 0), do: given(function)
  def find(place), do: look_up(place)

  defp given(function) do
    place = function.()

    if place?(place),
      do: look_up(place),
      else: {:error, {:no_program, "gave #{inspect(place)}, expected #{@expected}"}}
  catch
    kind, reason ->
      failed = Exception.format_banner(kind, reason, __STACKTRACE__)
      {:error, {:no_program, "failed with #{failed}"}}
  end

  defp look_up({app, name}) do
    case :code.lib_dir(app) do
      {:error, :bad_name} -> {:error, {:unknown_application, app}}
      folder -> first([Path.join([folder, "priv", "bin", name])], {app, name})
    end
  end

  # A name with a slash is a path, as for a shell.
  defp look_up(name) do
    if String.contains?(name, "/"),
      do: first([name], name),
      else: first([shipped(name) | Enum.map(search_path(), &Path.join(&1, name))], name)
  end

  defp search_path, do: "PATH" |> System.get_env("") |> String.split(":", trim: true)

  # Of several files that are there the first that can be run, as for a shell.
  defp first(candidates, place) do
    there = Enum.filter(candidates, &File.regular?/1)

    case {Enum.find(there, &executable?/1), there} do
      {nil, []} -> {:error, {:program_not_found, place}}
      {nil, [file | _]} -> {:error, {:not_executable, Path.expand(file)}}
      {program, _there} -> {:ok, program}
    end
  end

  defp executable?(file), do: (File.stat!(file).mode &&& 0o111) != 0

  @doc "The path of a program that ships with Ganglion, whether it is there or not."
  @spec shipped(String.t()) :: Path.t()
  def shipped(name), do: Application.app_dir(:ganglion, ["priv", "bin", name])

  @doc """
  A reason in words.

      iex> BB.Sensor.NativeProcess.Program.explain({:not_executable, "/opt/rover/detect.py"})
      "/opt/rover/detect.py is there and may not be run: make it executable (chmod +x)"
      iex> BB.Sensor.NativeProcess.Program.explain({:unknown_application, :rovr})
      "there is no application :rovr here: correct its name in `program:`, or add it to the project"
  """
  @spec explain(reason()) :: String.t()
  def explain({:program_not_found, {app, name}}) do
    "there is no program #{name} in the priv/bin of #{inspect(app)}: build it there, or correct " <>
      "its name in `program:`" <> unasked(app, name)
  end

  def explain({:program_not_found, name}) do
    if String.contains?(name, "/"),
      do: "there is no program #{name}: correct its path in `program:`, or put it there",
      else:
        "there is no program #{name}: it is neither in priv/bin nor in PATH" <>
          unasked(:ganglion, name)
  end

  def explain({:not_executable, path}),
    do: "#{path} is there and may not be run: make it executable (chmod +x)"

  def explain({:unknown_application, app}) do
    "there is no application #{inspect(app)} here: correct its name in `program:`, or add it to " <>
      "the project"
  end

  def explain({:no_program, text}), do: "the function in `program:` #{text}"

  defp unasked(app, name) do
    if app == :ganglion and Enum.member?(@unasked, name),
      do: "; it is built when `config :ganglion, programs:` has #{inspect(String.to_atom(name))}",
      else: ""
  end
end

defmodule BB.Test.Chaos.Soak.Subject do
  @moduledoc """
  A program under soak: a VM with a robot and `BB.Test.Chaos.Soak.Sampler`, and its figures from
  the operating system.
  """

  alias BB.Test.Chaos.Soak.Sampler
  alias BB.Test.{Native, Run}

  @enforce_keys [:name, :port, :samples, :topics, :folder]
  defstruct @enforce_keys

  @doc "Starts a command, with folders of its own for ring topics and files."
  def start(name, [program | arguments], env \\ []) do
    folder = Path.join(System.tmp_dir!(), Run.unique("soak-#{name}"))
    topics = Path.join("/dev/shm", Run.unique("soak-#{name}"))
    for made <- [folder, topics], do: File.mkdir_p!(made)
    samples = Path.join(folder, "samples")

    port =
      Port.open({:spawn_executable, "/bin/sh"}, [
        :binary,
        :exit_status,
        args: ["-c", ~s(exec "$0" "$@" >/dev/null 2>"$SOAK_LOG"), program | arguments],
        env:
          charlists(
            [
              {"SOAK_LOG", Path.join(folder, "log")},
              {"GANGLION_SOAK_SAMPLES", samples},
              {"CONDUIT_RING_DIR", topics},
              {"ERL_AFLAGS", load(folder)},
              {"MIX_ENV", "dev"}
            ] ++ env
          )
      ])

    %__MODULE__{name: name, port: port, samples: samples, topics: topics, folder: folder}
  end

  defp charlists(env),
    do: for({key, value} <- env, do: {String.to_charlist(key), String.to_charlist(value)})

  # A release loads no module that it does not contain.
  defp load(folder) do
    {Sampler, beam, _file} = :code.get_object_code(Sampler)
    file = Path.join(folder, "#{Sampler}")
    File.write!(file <> ".beam", beam)
    # The pid's number is its name, so that nothing has to be quoted.
    module = Sampler |> Atom.to_charlist() |> numbers()
    file = file |> String.to_charlist() |> numbers()
    "-eval code:load_abs(#{file}),apply(list_to_atom(#{module}),start,[])."
  end

  defp numbers(text), do: "[#{Enum.join(text, ",")}]"

  @doc "Returns its current figures by name, or `nil` before its VM has written a line."
  def figures(subject) do
    with [_ | _] = lines <- lines(subject), inside = parse(List.last(lines)) do
      {os_pid, inside} = Map.pop!(inside, "os_pid")
      programs = Native.descendants(os_pid)
      all = [os_pid | programs]

      Map.merge(inside, %{
        "threads" => sum(all, &status(&1, "Threads")),
        "descriptors" => sum(all, &descriptors/1),
        "rss" => 1024 * sum([os_pid], &status(&1, "VmRSS")),
        "native_rss" => 1024 * sum(programs, &status(&1, "VmRSS")),
        "native_processes" => length(programs),
        "shm" => shm(subject.topics)
      })
    else
      _not_yet -> nil
    end
  end

  defp lines(subject) do
    case File.read(subject.samples) do
      # The last line is complete only if it has its end.
      {:ok, text} -> text |> String.split("\n") |> Enum.drop(-1)
      {:error, _} -> []
    end
  end

  defp parse(line) do
    for pair <- String.split(line), [key, value] = String.split(pair, "="), into: %{} do
      {key, String.to_integer(value)}
    end
  end

  defp sum(pids, fun), do: pids |> Enum.map(fun) |> Enum.sum()

  defp status(os_pid, key) do
    with {:ok, text} <- File.read("/proc/#{os_pid}/status"),
         [_, value] <- Regex.run(~r/^#{key}:\s+(\d+)/m, text) do
      String.to_integer(value)
    else
      _gone -> 0
    end
  end

  defp descriptors(os_pid) do
    case File.ls("/proc/#{os_pid}/fd") do
      {:ok, all} -> length(all)
      {:error, _} -> 0
    end
  end

  defp shm(folder) do
    for file <- File.ls!(folder),
        {:ok, %{size: size}} <- [File.stat(Path.join(folder, file))],
        reduce: 0 do
      sum -> sum + size
    end
  end

  @doc "Tells whether it runs."
  def running?(subject), do: Port.info(subject.port) != nil

  @doc "Returns its log."
  def log(subject), do: File.read!(Path.join(subject.folder, "log"))

  @doc """
  Stops it as a person would, and waits; kills it if it does not end. No process or file remains.
  """
  def stop(subject) do
    with {:os_pid, os_pid} <- Port.info(subject.port, :os_pid) do
      all = [os_pid | Native.descendants(os_pid)]
      System.cmd("kill", ["-TERM", to_string(os_pid)], stderr_to_stdout: true)

      receive do
        {port, {:exit_status, _status}} when port == subject.port -> :ok
      after
        30_000 -> :ok
      end

      for pid <- all, Native.running?(pid), do: Native.end_by_force(pid)
    end

    for folder <- [subject.folder, subject.topics], do: File.rm_rf!(folder)
    :ok
  end
end

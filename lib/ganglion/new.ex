defmodule Ganglion.New do
  @moduledoc """
  Generates a project for a robot that depends on Ganglion.

  `mix ganglion.new` and `bin/new` call it; `Mix.Tasks.Ganglion.New` documents their options.

      {:ok, report} = Ganglion.New.run(["../rover"], from: File.cwd!(), checkout: File.cwd!())
  """

  alias Ganglion.New.{Options, Templates}

  @doc """
  Writes the project that `argv` describes and returns a report for the person.

  Invalid arguments return `{:error, sentence}`, and nothing is written. Relative paths in `argv`
  are relative to `from`; `checkout` is the folder of the Ganglion that runs.
  """
  @spec run([String.t()], from: Path.t(), checkout: Path.t()) ::
          {:ok, String.t()} | :help | {:error, String.t()}
  def run(argv, where) do
    with {:ok, options} <- Options.parse(argv, where) do
      files = Templates.files(options)

      case write(options.path, files) do
        :ok ->
          {:ok, report(options, files, where[:from])}

        {:error, file, reason} ->
          {:error, "could not write #{file}: #{:file.format_error(reason)}"}
      end
    end
  end

  @doc """
  Runs `run/2` for `bin/new`, prints its result and halts the VM.

  After an error the status is 1, and the sentence is on standard error.
  """
  @spec main([String.t()], from: Path.t(), checkout: Path.t()) :: no_return()
  def main(argv, where) do
    case run(argv, where) do
      {:ok, report} ->
        IO.write(report)
        System.halt(0)

      {:error, sentence} ->
        IO.puts(:stderr, "new: #{sentence}")
        System.halt(1)
    end
  end

  defp write(path, files) do
    Enum.find_value(files, :ok, fn {file, text, executable?} ->
      file = Path.join(path, file)

      with :ok <- File.mkdir_p(Path.dirname(file)),
           :ok <- File.write(file, text),
           :ok <- if(executable?, do: File.chmod(file, 0o755), else: :ok) do
        nil
      else
        {:error, reason} -> {:error, file, reason}
      end
    end)
  end

  defp report(options, files, from) do
    path = Path.relative_to(options.path, from)
    path = if options.path == from, do: ".", else: path

    """
    #{Enum.map_join(files, "\n", fn {file, _, _} -> "* #{file}" end)}

    #{options.module} is in #{path}. Next:

        cd #{path}
        bin/demo          # your robot on simulated buses; Ctrl-C stops it
        bin/test          # its tests

    The robot is lib/#{options.app}.ex; its own driver is lib/#{options.app}/thermometer.ex.
    #{boards(options.targets)}\
    """
  end

  defp boards([]), do: "README.md describes the rest.\n"

  defp boards([board | _]) do
    """
    For a board, with Nerves installed (README.md describes how):

        MIX_TARGET=#{board} mix deps.get
        MIX_TARGET=#{board} mix firmware
    """
  end
end

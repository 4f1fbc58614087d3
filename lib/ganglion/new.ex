defmodule Ganglion.New do
  @moduledoc """
  Writes a project of one's own: a robot on Ganglion, as firmware for boards and on simulated buses. Behind `mix ganglion.new` and
  `bin/new`; `Mix.Tasks.Ganglion.New` says how it is used.

      {:ok, report} = Ganglion.New.run(["../rover"], from: File.cwd!(), checkout: File.cwd!())
  """

  alias Ganglion.New.{Options, Templates}

  @doc """
  Writes the project that `argv` asks for and returns what to tell the person. A mistake is `{:error, sentence}`, with nothing written.

  `from` is the folder from which relative paths count, `checkout` the Ganglion that asks.
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
          {:error, "#{file} cannot be written: #{:file.format_error(reason)}"}
      end
    end
  end

  @doc "The same for `bin/new`, which ends the VM: with status 1 and a line on standard error after a mistake."
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

    The robot is lib/#{options.app}.ex, and a driver of your own lib/#{options.app}/thermometer.ex.
    #{boards(options.targets)}\
    """
  end

  defp boards([]), do: "README.md tells the rest.\n"

  defp boards([board | _]) do
    """
    For a board, with Nerves installed (README.md tells how):

        MIX_TARGET=#{board} mix deps.get
        MIX_TARGET=#{board} mix firmware
    """
  end
end

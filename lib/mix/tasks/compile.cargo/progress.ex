defmodule Mix.Tasks.Compile.Cargo.Progress do
  @moduledoc """
  Prints the output of cargo line by line on standard error.

  `Mix.Tasks.Compile.Cargo` collects the output of `System.cmd/3` into it. cargo ends each build
  with a line "Finished". That line is left out if cargo has built nothing.

      alias Mix.Tasks.Compile.Cargo.Progress
      System.cmd("cargo", ["build"], into: %Progress{}, stderr_to_stdout: true)
  """

  defstruct rest: "", shown?: false

  @typedoc "The text after the last complete line, and whether a line has been printed."
  @type t :: %__MODULE__{rest: String.t(), shown?: boolean()}

  @doc "Adds output of cargo. Returns the text to print now and the new state."
  @spec take(t(), String.t()) :: {String.t(), t()}
  def take(%__MODULE__{} = progress, text) do
    {lines, [rest]} = (progress.rest <> text) |> String.split("\n") |> Enum.split(-1)

    {shown, progress} = Enum.flat_map_reduce(lines, %{progress | rest: rest}, &line/2)
    {Enum.join(shown), progress}
  end

  defp line(line, progress) do
    if not progress.shown? and begins_with?(line, "Finished"),
      do: {[], progress},
      else:
        {[line, "\n"],
         %{progress | shown?: progress.shown? or not begins_with?(line, "Blocking")}}
  end

  defp begins_with?(line, word), do: line =~ ~r/\A(\e\[[\d;]*m|\s)*#{word}\b/

  defimpl Collectable do
    alias Mix.Tasks.Compile.Cargo.Progress

    def into(progress), do: {progress, &collect/2}

    defp collect(progress, {:cont, text}), do: show(Progress.take(progress, text))
    defp collect(progress, :done), do: if(progress.rest == "", do: progress, else: last(progress))
    defp collect(_progress, :halt), do: :ok

    defp last(progress), do: show(Progress.take(progress, "\n"))

    defp show({text, progress}) do
      _ = unless text == "", do: IO.write(:stderr, text)
      progress
    end
  end
end

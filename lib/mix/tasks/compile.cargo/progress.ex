defmodule Mix.Tasks.Compile.Cargo.Progress do
  @moduledoc """
  Shows what cargo says, line by line, on standard error. For `System.cmd(…, into: %Progress{})`.

  cargo ends with a line that it has finished, also when there was nothing to do: alone, or after a
  line that says for what it waits, it is not shown.
  """

  defstruct rest: "", shown?: false

  @type t :: %__MODULE__{rest: String.t(), shown?: boolean()}

  @doc "Takes what cargo has printed: the text to show now, and what is left of it for later."
  @spec take(t(), String.t()) :: {String.t(), t()}
  def take(%__MODULE__{} = progress, text) do
    {lines, [rest]} = (progress.rest <> text) |> String.split("\n") |> Enum.split(-1)

    {shown, progress} = Enum.flat_map_reduce(lines, %{progress | rest: rest}, &line/2)
    {Enum.join(shown), progress}
  end

  defp line(line, progress) do
    if not progress.shown? and said?(line, "Finished"),
      do: {[], progress},
      else: {[line, "\n"], %{progress | shown?: progress.shown? or not said?(line, "Blocking")}}
  end

  defp said?(line, word), do: line =~ ~r/\A(\e\[[\d;]*m|\s)*#{word}\b/

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

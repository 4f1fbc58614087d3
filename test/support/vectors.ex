defmodule BB.Test.Vectors do
  @moduledoc "Reads the dumps of docs/wire-format.md, as the tests of every language do."

  @page Path.expand("../../docs/wire-format.md", __DIR__)

  @doc """
  Returns the bytes of the dump with this name. `00*4` is a byte repeated four times; # begins a
  comment.
  """
  def read!(name) do
    [_, dump] = Regex.run(~r/^```hex #{name}\n(.*?)^```/ms, File.read!(@page))

    for word <- dump |> String.replace(~r/#.*$/m, "") |> String.split(),
        into: <<>>,
        do: bytes(String.split(word, "*"))
  end

  defp bytes([byte]), do: Base.decode16!(byte, case: :lower)
  defp bytes([byte, times]), do: :binary.copy(bytes([byte]), String.to_integer(times))
end

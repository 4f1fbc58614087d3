defmodule BB.Test.Vectors do
  @moduledoc "The encodings' test vectors, which the tests of every language read."

  @folder Path.expand("../../native/ganglion_messages/tests/vectors", __DIR__)

  @doc "The bytes of a vector: hexadecimal digits; from # to the end of a line is comment."
  def read!(name) do
    [@folder, name]
    |> Path.join()
    |> File.read!()
    |> String.replace(~r/#.*$/m, "")
    |> String.replace(~r/\s/, "")
    |> Base.decode16!(case: :lower)
  end
end

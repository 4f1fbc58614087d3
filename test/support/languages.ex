defmodule BB.Test.Languages do
  @moduledoc """
  Programs in C++, Python and Rust that exchange verifiable messages with each other and with the
  test.

  See native/languages/README.md.
  """

  import Bitwise

  @folder Path.expand("../../native/languages", __DIR__)
  @built Path.expand("../../_build/languages", __DIR__)
  @python Path.expand("../../_build/py/venv/bin/python", __DIR__)

  @longest_body 61_440
  @header 20

  @doc "Returns the slot size of topics for the longest message."
  def slot_size, do: 20 + @header + @longest_body

  @doc "Builds the programs. Raises with the compilers' output if that fails."
  def build! do
    case System.cmd(Path.join(@folder, "build.sh"), [], stderr_to_stdout: true) do
      {_output, 0} -> :ok
      {output, status} -> raise "native/languages/build.sh ended with #{status}:\n#{output}"
    end
  end

  @doc "Returns the command line of a language's program."
  def command("cpp"), do: [Path.join(@built, "cpp")]
  def command("rust"), do: [Path.join(@built, "rust")]
  def command("python"), do: [@python, "-B", Path.join(@folder, "peer.py")]

  @doc "Returns message `n` of a topic."
  def message(topic, n) do
    length = rem(n * 2_654_435_761 &&& 0xFFFF_FFFF, @longest_body + 1)
    word = <<n * 0x9E37_79B9_7F4A_7C15::little-64>>
    body = word |> :binary.copy(div(length, 8) + 1) |> binary_part(0, length)
    head = <<n::little-64, :erlang.crc32(topic)::little-32, length::little-32>>
    head <> <<:erlang.crc32([head, body])::little-32>> <> body
  end
end

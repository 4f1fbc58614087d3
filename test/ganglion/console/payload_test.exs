defmodule Ganglion.Console.PayloadTest do
  use ExUnit.Case, async: true

  alias Ganglion.Console.{Payload, Plain}

  doctest Payload

  # Any payload may be published, also that of a user's robot.
  test "every payload is one line with its numbers" do
    for module <- payloads() do
      line = Payload.line(struct(module, filled(module)))
      assert line == Plain.line(line)
      assert String.length(line) < 2_000
    end
  end

  test "long values and bytes are cut, and no value raises" do
    assert Payload.line(%{ranges: Enum.to_list(1..100)}) =~ "1, 2"
    assert Payload.line(Enum.to_list(1..100)) == "1 2 3 4 5 6 ... (100)"
    assert Payload.line(<<0::800>>) == "<100 bytes>"
    assert Payload.line(String.duplicate("x", 100)) == "<100 bytes>"
    assert Payload.line({1.0e-9, 1.0e12, 0.0}) == "1.000e-09 1.000e+12 0.0"
    assert Payload.line([1 | 2]) == "[1 | 2]"

    for odd <- [nil, :atom, self(), make_ref(), &is_nil/1, [], {}, %{}, ~D[2026-01-02]],
        do: assert(is_binary(Payload.line(odd)))
  end

  defp payloads do
    for module <- Application.spec(:ganglion, :modules),
        String.starts_with?(inspect(module), "BB.Message."),
        Code.ensure_loaded?(module) and function_exported?(module, :__struct__, 0),
        do: module
  end

  defp filled(module) do
    for name <- module.__struct__() |> Map.from_struct() |> Map.keys(), do: {name, 0.25}
  end
end

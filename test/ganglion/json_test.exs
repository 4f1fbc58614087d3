defmodule Ganglion.JsonTest do
  use ExUnit.Case, async: true

  doctest Ganglion.Json

  defp encode(term), do: term |> Ganglion.Json.encode() |> IO.iodata_to_binary()

  test "special characters of a string are escaped, all others stay" do
    assert encode(~s(a"b\\c)) == ~S("a\"b\\c")
    assert encode("a\nb\tc\0") == ~S("a\nb\u0009c\u0000")
    assert encode("Grüße, 漢字") == ~S("Grüße, 漢字")
  end

  test "keys are sorted by their text, atoms and strings alike" do
    assert encode(%{"b" => 1, :a => 2, "c" => %{}}) == ~S({"a":2,"b":1,"c":{}})
  end

  test "nil, true and false are JSON values at any depth; other atoms are strings" do
    assert encode([nil, true, false, :up]) == ~S([null,true,false,"up"])
  end

  test "an empty list and an empty map are encoded" do
    assert encode([[], %{}]) == "[[],{}]"
  end
end

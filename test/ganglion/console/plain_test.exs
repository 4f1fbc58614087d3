defmodule Ganglion.Console.PlainTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  alias Ganglion.Console.Plain

  doctest Plain

  property "any text becomes one line of ASCII, and one of ASCII stays as it is", numtests: 500 do
    char = oneof([integer(0x20, 0x7E), integer(0, 0x2FF), integer(0x2000, 0xD7FF)])

    forall chars <- list(char) do
      text = List.to_string(chars)
      line = Plain.line(text)
      assert for(<<char <- line>>, char not in 0x20..0x7E, do: char) == []
      if text =~ ~r/\A[ -~]*\z/ and not (text =~ "errno"), do: assert(line == text)
      true
    end
  end

  test "bytes that are no text are inspected" do
    assert Plain.line(<<0xFF, 0xFE>>) == "<<255, 254>>"
  end

  test "errors of the kernel are explained in any form" do
    for error <- [{:errno, 28}, :enospc] do
      assert Plain.format_error(error) == "no space left on device"
    end

    assert Plain.line("{:error, {:errno, 13}}") =~ "permission denied"
    assert Plain.line("open failed with errno 13") =~ "permission denied"
    assert Plain.line("errno 28 (no space)") == "errno 28 (no space)"
    assert Plain.format_error({:errno, 9_999}) == "{:errno, 9999}"
    assert Plain.format_error(:bus_not_found) == ":bus_not_found"
    assert Plain.format_error({:bad, "ä"}) == ~s({:bad, "a"})
  end
end

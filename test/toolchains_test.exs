defmodule ToolchainsTest do
  @moduledoc "Holds what newer compilers ask for and older ones must bear, which the compiler at hand may not show."

  use ExUnit.Case, async: true

  alias BB.Test.BitStrings

  @sources Path.wildcard("{bench,config,examples,lib,rel,test}/**/*.{ex,exs}") ++ ["mix.exs"]

  describe "Elixir" do
    test "1.14 and 1.20 both take the sizes in all bit-string patterns" do
      found =
        for file <- @sources,
            {size, line} <- BitStrings.find(file),
            do: "#{file}:#{line}: #{size}"

      assert found == [],
             "bind the size in the same pattern, or use binary_part/3 or :erlang.split_binary/2"
    end

    test "a size from outside of its pattern is found, however the pattern is written" do
      for {text, size} <- [
            {"<<a::binary-size(n), _::binary>> = b", "n"},
            {"{:ok, <<a::size(n)>>} = b", "n"},
            {"<<a::size(n * 8)>> = b", "n * 8"},
            {"<<a::size(n)-unit(8)-little>> = b", "n"},
            {"<<a::n*8>> = b", "n"},
            {"<<m::8, a::size(m), b::size(n)>> = c", "n"},
            {"<<a::size(a)>> = b", "a"},
            {"case b do <<a::size(n)>> when a > 1 -> a end", "n"},
            {"fn <<a::size(n)>>, _ -> a end", "n"},
            {"receive do <<a::size(n)>> -> a end", "n"},
            {"with {:ok, <<a::size(n)>>} <- b, do: a", "n"},
            {"for <<a::size(n) <- b>>, do: a", "n"},
            {"for <<m::8, a::size(m + n) <- b>>, do: a", "m + n"},
            {"for <<a::size(n)>> <- b, do: a", "n"},
            {"def f(<<a::size(n)>>), do: a", "n"},
            {"defp f(<<a::size(n)>>) when a > 1, do: a", "n"},
            {"match?(<<_::size(n)>>, b)", "n"},
            {"assert_receive {:data, <<_::binary-size(n)>>}", "n"},
            {"<<a::size(^n)>> = b", "^n"},
            {"<<m::8, a::size(^m)>> = b", "^m"}
          ] do
        assert BitStrings.find(text, "a.ex") == [{"size(#{size})", 1}], text
      end
    end

    test "a size that the pattern binds, and one that builds a bit string, are left alone" do
      for text <- [
            "<<n::8, a::binary-size(n), b::size(n * 8), _::binary>> = c",
            "<<n::8, a::n*8>> = c",
            "<<a::binary-size(4), b::size(@n), c::size(unquote(n))>> = d",
            "a = <<0::size(n)-unit(8)>>",
            "case n do n -> <<0::size(n)>> end",
            "for <<n::8, a::binary-size(n) <- b>>, do: <<a::size(n)>>",
            "f(<<a::size(n)>>)"
          ] do
        assert BitStrings.find(text, "a.ex") == [], text
      end
    end
  end
end

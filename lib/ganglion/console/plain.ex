defmodule Ganglion.Console.Plain do
  @moduledoc """
  Converts text to one line of ASCII, with the kernel's errors in words.

  The console uses it for each text that it prints. A command over ssh (`ssh host '…'`) drops each
  write with a character beyond Latin-1, and the text of a driver or a robot may have any
  character. A character with an ASCII counterpart becomes that counterpart, any other becomes
  `?`.

      iex> Ganglion.Console.Plain.line("5 µm² – naïve…\\n日本")
      "5 um2 - naive... ??"
      iex> Ganglion.Console.Plain.line("write failed with errno 28")
      "write failed with errno 28 (no space left on device)"
  """

  alias BB.Errno

  @spelled %{
    "…" => "...",
    "–" => "-",
    "—" => "-",
    "−" => "-",
    "·" => ".",
    "•" => "*",
    "×" => "x",
    "÷" => "/",
    "±" => "+-",
    "≤" => "<=",
    "≥" => ">=",
    "≠" => "!=",
    "≈" => "~",
    "→" => "->",
    "►" => ">",
    "←" => "<-",
    "°" => "deg",
    "\u00B5" => "u",
    "\u03BC" => "u",
    "\u03A9" => "Ohm",
    "\u2126" => "Ohm",
    "π" => "pi",
    "‘" => "'",
    "’" => "'",
    "“" => "\"",
    "”" => "\"",
    "„" => "\"",
    "«" => "\"",
    "»" => "\"",
    "ß" => "ss",
    "æ" => "ae",
    "Æ" => "AE",
    "ø" => "o",
    "Ø" => "O",
    "ł" => "l",
    "Ł" => "L"
  }

  @doc "Returns the text as one line of ASCII. Bytes that are no text are inspected."
  @spec line(String.t()) :: String.t()
  def line(text) do
    if String.valid?(text),
      do:
        text
        |> String.replace(~r/[\p{Cc}\p{Cf}\p{Zl}\p{Zp}]+/u, " ")
        |> explain_errnos()
        |> ascii(),
      else: text |> inspect(limit: 50) |> ascii()
  end

  @doc """
  Formats the reason of an `{:error, reason}`. Numbers and names of the kernel's errors become
  words.

      iex> Ganglion.Console.Plain.format_error({:errno, 28})
      "no space left on device"
      iex> Ganglion.Console.Plain.format_error(:enospc)
      "no space left on device"
  """
  @spec format_error(term()) :: String.t()
  def format_error({:errno, number} = error) do
    case errno(number) do
      nil -> inspect(error)
      words -> words
    end
  end

  def format_error(text) when is_binary(text), do: line(text)

  def format_error(posix) when is_atom(posix) do
    case :file.format_error(posix) do
      ~c"unknown POSIX error" ++ _rest -> inspect(posix)
      words -> line(List.to_string(words))
    end
  end

  def format_error(term), do: line(inspect(term, limit: 20))

  # Adds the words to `errno 28` and `{:errno, 28}`, unless they follow already.
  defp explain_errnos(text) do
    Regex.replace(~r/(?:\{:errno, (\d+)\}|\berrno (\d+)\b)(?! \()/, text, fn all, one, other ->
      case errno(String.to_integer(one <> other)) do
        nil -> all
        words -> "#{all} (#{words})"
      end
    end)
  end

  defp errno(number) do
    case Errno.fetch(number) do
      {:ok, words} -> words
      :error -> nil
    end
  end

  defp ascii(text) do
    if List.ascii_printable?(String.to_charlist(text)),
      do: text,
      else: text |> String.graphemes() |> Enum.map_join(&spell/1)
  end

  defp spell(<<char>>) when char in 0x20..0x7E, do: <<char>>

  defp spell(grapheme) do
    case Map.fetch(@spelled, grapheme) do
      {:ok, spelled} -> spelled
      :error -> grapheme |> :unicode.characters_to_nfkd_list() |> base()
    end
  end

  # A letter without its diacritics.
  defp base(chars) when is_list(chars) do
    case for(char <- chars, char in 0x20..0x7E, do: char) do
      [] -> "?"
      plain -> List.to_string(plain)
    end
  end

  defp base(_no_text), do: "?"
end

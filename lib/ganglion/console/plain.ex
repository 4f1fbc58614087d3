defmodule Ganglion.Console.Plain do
  @moduledoc """
  Text that arrives wherever it is printed: ASCII, one line, and the kernel's errors in words.

  A write with a character beyond Latin-1 is dropped whole where a command runs over ssh (`ssh
  host '…'`), and what a driver, a robot or a card says may have any character. What has a
  counterpart in ASCII is spelled by it, what has none is a `?`.

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

  @doc "The text as one line. What is no text is shown as Elixir writes it."
  @spec line(String.t()) :: String.t()
  def line(text) do
    if String.valid?(text),
      do: text |> String.replace(~r/[\p{Cc}\p{Cf}\p{Zl}\p{Zp}]+/u, " ") |> errnos() |> ascii(),
      else: text |> inspect(limit: 50) |> ascii()
  end

  @doc "An error of the world in words: `{:errno, 28}` and `:enospc` are the same."
  @spec words(term()) :: String.t()
  def words({:errno, number} = error) do
    case errno(number) do
      nil -> inspect(error)
      words -> words
    end
  end

  def words(text) when is_binary(text), do: line(text)

  def words(posix) when is_atom(posix) do
    case :file.format_error(posix) do
      ~c"unknown POSIX error" ++ _rest -> inspect(posix)
      words -> line(List.to_string(words))
    end
  end

  def words(term), do: line(inspect(term, limit: 20))

  # `errno 28`, and `{:errno, 28}` inside of what was inspected; not where the words follow
  # already.
  defp errnos(text) do
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

  # A letter without its marks.
  defp base(chars) when is_list(chars) do
    case for(char <- chars, char in 0x20..0x7E, do: char) do
      [] -> "?"
      plain -> List.to_string(plain)
    end
  end

  defp base(_no_text), do: "?"
end

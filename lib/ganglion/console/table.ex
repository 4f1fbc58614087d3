defmodule Ganglion.Console.Table do
  @moduledoc """
  Formats tables and lines for a terminal of 80 columns, in ASCII (`Ganglion.Console.Plain`).

  The console and the demonstration use it. It is pure.

      iex> Ganglion.Console.Table.render(["sensor", "Hz"], [[:imu, 100.04], [:camera, nil]])
      "sensor  Hz\\nimu     100.0\\ncamera  -\\n"
  """

  alias Ganglion.Console.Plain

  @width 80
  @gap "  "
  @narrowest 4
  @dots 3

  @typedoc "The content of a cell; `nil` is shown as `-`."
  @type cell :: String.t() | atom() | number() | nil | [atom()]

  @doc """
  Returns a table with a line for the header and one for each row.

  A table that is too wide has its widest columns cut.
  """
  @spec render([String.t()], [[cell()]], pos_integer()) :: String.t()
  def render(header, rows, width \\ @width) do
    lines = Enum.map([header | rows], fn row -> Enum.map(row, &text/1) end)
    widths = lines |> natural() |> shrink(width - (length(header) - 1) * String.length(@gap))
    Enum.map_join(lines, &line(&1, widths))
  end

  @doc """
  Returns the text as one line, cut to the width.

      iex> Ganglion.Console.Table.cut("a\\nlong line", 7)
      "a lo..."
  """
  @spec cut(String.t(), pos_integer()) :: String.t()
  def cut(text, width \\ @width) do
    text = plain(text)

    cond do
      String.length(text) <= width -> text
      width > @dots * 2 -> String.slice(text, 0, width - @dots) <> "..."
      true -> String.slice(text, 0, width)
    end
  end

  @doc """
  Wraps a text into lines of at most the width. Each line after the first has an indent.

      iex> Ganglion.Console.Table.wrap("imu: no answer at 0x68", 12)
      "imu: no\\n  answer at\\n  0x68\\n"
  """
  @spec wrap(String.t(), pos_integer()) :: String.t()
  def wrap(text, width \\ @width) do
    {first, rest} = text |> plain() |> String.split() |> List.pop_at(0, "")
    lines = Enum.reduce(rest, [first], &fill(&1, &2, width))
    lines |> Enum.reverse() |> Enum.map_join(&(cut(&1, width) <> "\n"))
  end

  defp fill(word, [line | lines], width) do
    if String.length(line) + 1 + String.length(word) <= width,
      do: [line <> " " <> word | lines],
      else: ["  " <> word, line | lines]
  end

  @doc """
  Returns the line with the last error of a row of `BB.Sensor.health/1`, or `""` without an error.

      iex> Ganglion.Console.Table.trouble(%{name: :imu, state: :up, error: "no answer at 0x68"})
      "imu was down: no answer at 0x68\\n"
  """
  @spec trouble(map()) :: String.t()
  def trouble(%{error: nil}), do: ""
  def trouble(%{state: :up} = row), do: wrap("#{row.name} was down: #{row.error}")
  def trouble(row), do: wrap("#{row.name}: #{row.error}")

  @doc """
  Formats a duration in nanoseconds.

      iex> Ganglion.Console.Table.age(12_345_678)
      "12 ms"
  """
  @spec age(integer() | nil) :: String.t() | nil
  def age(nil), do: nil
  def age(ns) when ns < 10_000_000_000, do: "#{div(ns, 1_000_000)} ms"
  def age(ns), do: "#{div(ns, 1_000_000_000)} s"

  defp text(nil), do: "-"
  defp text(text) when is_binary(text), do: plain(text)
  defp text(value) when is_atom(value), do: value |> Atom.to_string() |> plain()
  defp text(value) when is_integer(value), do: Integer.to_string(value)
  defp text(value) when is_float(value), do: :erlang.float_to_binary(value, decimals: 1)
  defp text(value), do: value |> inspect(limit: 50) |> plain()

  defp plain(text), do: Plain.line(text)

  defp natural(lines),
    do:
      lines |> Enum.zip_with(fn column -> column |> Enum.map(&String.length/1) |> Enum.max() end)

  defp shrink(widths, room) do
    widest = Enum.max(widths, fn -> 0 end)

    if Enum.sum(widths) <= room or widest <= @narrowest,
      do: widths,
      else: widths |> narrow(widest) |> shrink(room)
  end

  defp narrow(widths, widest),
    do: List.update_at(widths, Enum.find_index(widths, &(&1 == widest)), &(&1 - 1))

  defp line(cells, widths) do
    cells
    |> Enum.zip_with(widths, fn cell, width ->
      cell |> cut(max(width, 1)) |> String.pad_trailing(width)
    end)
    |> Enum.join(@gap)
    |> String.trim_trailing()
    |> Kernel.<>("\n")
  end
end

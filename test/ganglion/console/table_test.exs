defmodule Ganglion.Console.TableTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  alias Ganglion.Console.Table

  doctest Table

  property "no line is longer than the width, whatever is in the cells", numtests: 300 do
    cell =
      oneof([
        binary(),
        integer(),
        float(),
        atom(),
        list(integer(0, 1_114)),
        exactly(String.duplicate("ä", 90))
      ])

    forall {columns, rows} <- {integer(1, 7), list(vector(7, cell))} do
      header = Enum.map(1..columns, &"column #{&1}")

      lines =
        header |> Table.render(Enum.map(rows, &Enum.take(&1, columns))) |> String.split("\n")

      assert length(lines) == length(rows) + 2
      assert Enum.all?(lines, &(String.length(&1) <= 80))
      true
    end
  end
end

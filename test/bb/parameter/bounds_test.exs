defmodule BB.Parameter.BoundsTest do
  use ExUnit.Case, async: true

  doctest BB.Parameter.Bounds
end

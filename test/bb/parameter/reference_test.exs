defmodule BB.Parameter.ReferenceTest do
  use ExUnit.Case, async: true

  doctest BB.Parameter.Reference
end

defmodule BB.Parameter.DefinitionTest do
  use ExUnit.Case, async: true

  doctest BB.Parameter.Definition
end

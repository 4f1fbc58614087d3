defmodule BB.Dsl.ParamRefTest do
  use ExUnit.Case, async: true

  doctest BB.Dsl.ParamRef
end

defmodule BB.Parameter.StoreTest do
  use ExUnit.Case, async: true

  doctest BB.Parameter.Store
end

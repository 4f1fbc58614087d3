defmodule BB.ErrnoTest do
  use ExUnit.Case, async: true
  doctest BB.Errno
end

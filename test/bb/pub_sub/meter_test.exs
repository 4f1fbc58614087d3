defmodule BB.PubSub.MeterTest do
  use ExUnit.Case, async: true

  doctest BB.PubSub.Meter
end

defmodule BB.Firmware.RobotsTest do
  use ExUnit.Case, async: true

  alias BB.Firmware.Robots

  doctest Robots
end

defmodule BB.Sensor.System.ParserTest do
  use ExUnit.Case, async: true

  alias BB.Sensor.System.Parser

  doctest BB.Sensor.System
  doctest BB.Sensor.System.Parser

  test "each bit of the firmware is its cause, now and before" do
    for {hex, now, before} <- [
          {"0", [], []},
          {"1", [:under_voltage], []},
          {"2", [:frequency_capped], []},
          {"0x4", [:throttled], []},
          {"8", [:soft_temperature_limit], []},
          {"10000", [], [:under_voltage]},
          {"20000", [], [:frequency_capped]},
          {"40000", [], [:throttled]},
          {"80008", [:soft_temperature_limit], [:soft_temperature_limit]}
        ] do
      assert Parser.throttling(hex <> "\n") ==
               {:ok, %{throttling: now, throttled_before: before}}
    end
  end

  test "temperatures may be below zero" do
    assert Parser.temperature("-1500\n") == {:ok, %{temperature: -1.5}}
  end

  test "a text of another format is an error" do
    for text <- ["", "\n", "N/A\n", "0-\n", "MemTotal: 5 kB\n", "0.5 0.5\n"],
        parse <- [:temperature, :throttling, :memory, :load, :processors],
        do: assert({parse, text, apply(Parser, parse, [text])} == {parse, text, :error})
  end
end

defmodule Ganglion.Robots.AllTest do
  use ExUnit.Case, async: true

  alias Ganglion.Robots.All

  @drivers_without_device [BB.Sensor.System]

  test "has twelve devices, each in a place of its own" do
    sensors = for component <- All.robot().components, do: component
    wired = for s <- sensors, s.module not in @drivers_without_device, do: s.name
    assert length(sensors) == 12
    assert Enum.sort(wired) == All.World.places() |> Map.keys() |> Enum.sort()
    places = Map.values(All.World.places())
    assert places == Enum.uniq(places)
  end

  test "has every driver that ships for a device" do
    used = for component <- All.robot().components, uniq: true, do: component.module

    shipped =
      for file <- Path.wildcard("lib/bb/sensor/*.ex"),
          source = File.read!(file),
          source =~ ~r/use (BB\.Sensor\.)?Polled\b/,
          [_, name] = Regex.run(~r/defmodule ([\w.]+)/, source),
          do: Module.concat([name])

    assert (shipped -- [BB.Sensor.Polled]) -- used == []
  end

  test "each declares a rate and a max_silence" do
    for component <- All.robot().components do
      assert Code.ensure_loaded?(component.module) and
               function_exported?(component.module, :rate, 1)

      assert is_integer(component.max_silence_ns)
    end
  end
end

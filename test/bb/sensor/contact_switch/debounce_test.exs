defmodule BB.Sensor.ContactSwitch.DebounceTest do
  use ExUnit.Case, async: true

  alias BB.Sensor.ContactSwitch.Debounce

  doctest Debounce

  @ms 1_000_000

  test "a contact that is back where it was has not changed" do
    {:wait, _, d} = Debounce.edge(Debounce.new(5 * @ms, 1), 0)
    assert {:same, %{level: 1}} = Debounce.put_level(d, 5 * @ms, 1)
  end

  test "without a window it is looked at at once" do
    assert {:wait, 7, _d} = Debounce.edge(Debounce.new(0, 1), 7)
  end

  test "a contact that is pressed often, each time after a rest, is no noise" do
    Enum.reduce(1..1000, Debounce.new(5 * @ms, 1), fn n, d ->
      {:wait, until_ns, d} = Debounce.edge(d, n * 26 * @ms)
      {_what, d} = Debounce.put_level(d, until_ns, rem(n, 2))
      d
    end)
  end

  test "a contact that never rests is noise, 51 windows after the first edge" do
    waits =
      Stream.iterate({:wait, 0, Debounce.new(5 * @ms, 1)}, fn {:wait, until_ns, d} ->
        {_what, d} = if d.waiting?, do: Debounce.put_level(d, until_ns, 1), else: {:same, d}
        Debounce.edge(d, until_ns + 1)
      end)

    count = waits |> Stream.drop(1) |> Enum.find_index(&(&1 == :noise))
    assert count == 50
  end

  test "a contact that never rests is noise, also when each fourth edge is late" do
    verdict =
      Enum.reduce_while(1..200, Debounce.new(5 * @ms, 1), fn n, d ->
        late_ns = if rem(n, 4) == 0, do: 25 * @ms, else: 1
        rested_ns = d.rested_ns || 0

        case Debounce.edge(d, rested_ns + late_ns) do
          :noise -> {:halt, :noise}
          {:wait, until_ns, d} -> {:cont, d |> Debounce.put_level(until_ns, 1) |> elem(1)}
        end
      end)

    assert verdict == :noise
  end
end

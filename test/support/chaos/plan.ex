defmodule BB.Test.Chaos.Plan do
  @moduledoc """
  Plans which fault strikes which sensor of `Ganglion.Robots.All`, and for how long. Pure.

  The same seed gives the same plan. Sensors with common wires share a lane, in which faults
  follow one another; lanes run concurrently. An I2C bus is a lane, and so is each device on
  lines.

      iex> alias BB.Test.Chaos.Plan
      iex> places = %{imu: {:i2c, "i2c-1", 0x68}, bumper: {:gpio, "gpiochip0", :bumper, [17]}}
      iex> plan = Plan.new(places, 10, 42)
      iex> plan == Plan.new(places, 10, 42)
      true
      iex> plan |> Map.values() |> List.flatten() |> length()
      10
      iex> Map.keys(plan)
      [{:i2c, "i2c-1"}, {:gpio, "gpiochip0", :bumper, [17]}]
  """

  alias Ganglion.Robots.All.World

  @typedoc """
  `sensors` are the affected ones. `hold_ms` is the duration after it shows in health, `rest_ms`
  the pause of the lane after it.
  """
  @type strike :: %{
          place: World.place(),
          fault: term(),
          sensors: [atom()],
          hold_ms: non_neg_integer(),
          rest_ms: non_neg_integer()
        }

  @type lane :: term()

  @longest_hold_ms 400
  @longest_rest_ms 200

  @doc "Returns the strikes of each lane, in their order: `count` in all."
  @spec new(%{atom() => World.place()}, pos_integer(), integer()) :: %{lane() => [strike()]}
  def new(places, count, seed) do
    _ = :rand.seed(:exsss, seed)
    struck = places |> Map.keys() |> Enum.sort()

    1..count
    |> Enum.map(fn _ -> struck |> Enum.random() |> strike(places) end)
    |> Enum.group_by(&lane(&1.place))
  end

  @doc "Returns the lane of a place."
  @spec lane(World.place()) :: lane()
  def lane({:i2c, bus, _address}), do: {:i2c, bus}
  def lane(lines), do: lines

  defp strike(sensor, places) do
    fault = places[sensor] |> faults(sensor) |> Enum.random() |> draw()

    %{
      place: places[sensor],
      fault: fault,
      sensors: concerned(fault, sensor, places),
      hold_ms: :rand.uniform(@longest_hold_ms),
      rest_ms: :rand.uniform(@longest_rest_ms)
    }
  end

  defp concerned(:stuck, sensor, places) do
    lane = lane(places[sensor])
    for {other, place} <- places, lane(place) == lane, do: other
  end

  defp concerned(_fault, sensor, _places), do: [sensor]

  # The faults that each device can detect: an open contact equals a cut wire.
  defp faults({:i2c, _bus, _address}, _sensor),
    do: [:unplug, :nak, :timeout, :retry, :slow, :bit_errors, :stuck]

  defp faults({:gpio, _chip, _device, _lines}, :sonar), do: [:unplug, :cut, :storm]
  defp faults({:gpio, _chip, _device, [_a, _b]}, _encoder), do: [:cut_one]
  defp faults({:gpio, _chip, _device, _lines}, _contact), do: [:storm]

  defp draw(:slow), do: {:slow, 25 + :rand.uniform(35)}
  defp draw(:bit_errors), do: {:bit_errors, 0.3 + 0.7 * :rand.uniform(), :rand.uniform(1_000_000)}
  defp draw(:storm), do: {:storm, 500 + :rand.uniform(4_500)}
  defp draw(fault), do: fault
end

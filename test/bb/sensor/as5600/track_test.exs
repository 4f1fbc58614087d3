defmodule BB.Sensor.As5600.TrackTest do
  use ExUnit.Case, async: true

  alias BB.Sensor.As5600.Track

  doctest BB.Sensor.As5600.Track

  @ms 1_000_000
  @half :math.pi()

  defp steps(reading), do: round(reading.position / (2 * @half) * 4096)

  defp follow(track, angles, period_ms) do
    {readings, _track} =
      angles
      |> Enum.with_index()
      |> Enum.map_reduce(track, fn {angle, n}, track ->
        {:ok, reading, track} = Track.add(track, angle, n * period_ms * @ms)
        {reading, track}
      end)

    readings
  end

  test "the first position is in the turn that begins at the option" do
    for {from, angle, position} <- [
          {-@half, 0, 0},
          {-@half, 2047, 2047},
          {-@half, 2048, -2048},
          {-@half, 4095, -1},
          {0, 4095, 4095},
          {@half / 2, 1023, 5119},
          {@half / 2, 1024, 1024},
          {20 * @half, 7, 40_967}
        ] do
      assert {:ok, reading, _track} = Track.add(Track.new(from, 0.05), angle, 0)
      assert steps(reading) == position
      assert reading.velocity == nil
    end
  end

  test "the turns are counted in both directions" do
    turns = for n <- 0..50, do: n * 1000
    there = Enum.map(turns, &Integer.mod(&1, 4096))
    back = Enum.map(turns, &Integer.mod(-&1, 4096))

    assert Track.new(-@half, 0.05) |> follow(there, 10) |> Enum.map(&steps/1) == turns

    assert Track.new(-@half, 0.05) |> follow(back, 10) |> Enum.map(&steps/1) ==
             Enum.map(turns, &(-&1))
  end

  test "any way that is shorter than three eighths of a turn at each step is followed exactly" do
    for seed <- 1..50 do
      :rand.seed(:exsss, seed)

      positions =
        Enum.scan([0 | for(_ <- 1..200, do: :rand.uniform(2 * 1536 + 1) - 1537)], &(&1 + &2))

      angles = Enum.map(positions, &Integer.mod(&1, 4096))
      # After a long time the last velocity predicts nothing.
      readings = follow(Track.new(-@half, 0.001), angles, 10)
      assert Enum.map(readings, &steps/1) == positions
    end
  end

  test "the velocity is that over the window, by the times of the readings" do
    # A turn a second, in steps that the chip rounds.
    angles = for n <- 0..20, do: Integer.mod(round(n * 40.96), 4096)
    [first | readings] = follow(Track.new(0, 0.05), angles, 10)
    assert first.velocity == nil
    for reading <- readings, do: assert_in_delta(reading.velocity, 2 * @half, 0.2)
    assert_in_delta List.last(readings).velocity, 2 * @half, 0.03
  end

  test "a shaft at rest has no velocity after the window" do
    readings = follow(Track.new(0, 0.05), [0, 100, 200, 200, 200, 200, 200, 200, 200], 10)
    assert List.last(readings).velocity == 0.0
  end

  test "more than three eighths of a turn at once is too fast" do
    {:ok, _reading, track} = Track.add(Track.new(0, 0.05), 0, 0)
    assert {:ok, _reading, _track} = Track.add(track, 1536, 10 * @ms)
    assert Track.add(track, 1537, 10 * @ms) == {:error, :too_fast}
    assert {:ok, _reading, _track} = Track.add(track, 4096 - 1536, 10 * @ms)
    assert Track.add(track, 4096 - 1537, 10 * @ms) == {:error, :too_fast}
  end

  test "so is a pause in which a shaft that was so fast may have turned as far" do
    {:ok, _reading, track} = Track.add(Track.new(0, 0.05), 0, 0)
    {:ok, _reading, track} = Track.add(track, 1000, 10 * @ms)
    assert {:ok, _reading, _track} = Track.add(track, 2000, 25 * @ms)
    assert Track.add(track, 2000, 26 * @ms) == {:error, :too_fast}
  end

  test "new options go on with the turns" do
    {:ok, _reading, old} = Track.add(Track.new(0, 0.05), 4000, 0)
    {:ok, _reading, old} = Track.add(old, 100, 10 * @ms)
    new = Track.continue(Track.new(-@half, 0.1), old)
    assert {:ok, reading, _track} = Track.add(new, 200, 20 * @ms)
    assert steps(reading) == 4296
  end
end

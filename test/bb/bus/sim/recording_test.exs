defmodule BB.Bus.Sim.RecordingTest do
  use ExUnit.Case, async: true

  alias BB.Bus.Sim.Recording

  doctest BB.Bus.Sim.Recording

  @header "Time (s),Gyroscope X (deg/s),Gyroscope Y (deg/s),Gyroscope Z (deg/s)," <>
            "Accelerometer X (g),Accelerometer Y (g),Accelerometer Z (g)"

  defp parse(lines), do: Recording.parse(Enum.join([@header | lines], "\n"), "walk.csv")

  defp message(lines) do
    assert {:error, error} = parse(lines)
    Exception.message(error)
  end

  describe "reading" do
    test "gives SI units" do
      {:ok, recording} = parse(["0,180,0,-90,0,0.5,1"])

      assert [%{acceleration: {+0.0, y, z}, angular_velocity: rate}] =
               Recording.samples(recording)

      assert_in_delta y, 4.903325, 1.0e-12
      assert_in_delta z, 9.80665, 1.0e-12
      assert_in_delta elem(rate, 0), :math.pi(), 1.0e-12
      assert_in_delta elem(rate, 2), -:math.pi() / 2, 1.0e-12
    end

    test "takes exponents, spaces, more columns, Windows' line ends and a missing last one" do
      text = @header <> ",Extra\r\n0, 1e-3 ,2,3,4,5,6,7\r\n1,1.5E+1,2,3,4,5,6,7"
      assert {:ok, recording} = Recording.parse(text)
      assert Recording.size(recording) == 2
    end

    test "counts time from the first sample" do
      {:ok, recording} = parse(["10,0,0,0,0,0,1", "10.5,0,0,0,0,0,2"])
      assert recording.times == {0.0, 0.5}
    end
  end

  describe "an error names the file and the line" do
    test "of a header that is not this one" do
      assert {:error, %Recording.Error{reason: :wrong_header, line: 1} = error} =
               Recording.parse("t,gx,gy\n0,0,0", "walk.csv")

      assert Exception.message(error) =~
               ~r/^walk.csv:1: expected a header that begins with "Time \(s\),.*, got: "t,gx,gy"$/
    end

    test "with too few or too many columns" do
      assert message(["0,0,0,0,0,0,1", "1,2"]) == "walk.csv:3: expected 7 columns, got: 2"
      assert message(["0,0,0,0,0,0,1,2"]) == "walk.csv:2: expected 7 columns, got: 8"

      assert message(["0,0,0,0,0,0,1", "", "1,0,0,0,0,0,1"]) ==
               "walk.csv:3: expected 7 columns, got: 1"
    end

    test "where there is no number" do
      assert message(["0,0,0,0,0,0,1", "1,0,x,0,0,0,1"]) ==
               ~s(walk.csv:3: expected a number, got: "x")

      assert message(["0,0,0,0,0,nan,1"]) == ~s(walk.csv:2: expected a number, got: "nan")
      assert message(["0,0,0,0,0,1.5g,1"]) == ~s(walk.csv:2: expected a number, got: "1.5g")
      assert message(["0,0,0,0,0,,1"]) == ~s(walk.csv:2: expected a number, got: "")
    end

    test "whose time does not increase" do
      assert message(["1,0,0,0,0,0,1", "1,0,0,0,0,0,1"]) ==
               "walk.csv:3: expected a time later than 1.0, got: 1.0"
    end

    test "without a sample" do
      assert message([]) == "walk.csv: expected samples, got only a header"
    end

    test "that is empty" do
      assert {:error, %{reason: :wrong_header, line: 1}} = Recording.parse("")
    end

    test "that is not there" do
      assert {:error, %{reason: :enoent, line: nil} = error} = Recording.load("/no/such.csv")
      assert Exception.message(error) == "/no/such.csv: no such file or directory"
      assert_raise Recording.Error, fn -> Recording.load!("/no/such.csv") end
    end
  end

  describe "playing" do
    setup do
      {:ok, recording} = parse(for n <- 0..3, do: "#{n},0,0,0,0,0,#{n}")
      %{recording: recording}
    end

    defp shown(recording, seconds, at_end),
      do: (elem(Recording.at(recording, seconds, at_end).acceleration, 2) / 9.80665) |> round()

    test "shows the latest sample", %{recording: recording} do
      for {t, n} <- [{0, 0}, {0.9, 0}, {1.0, 1}, {2.5, 2}, {3, 3}],
          do: assert(shown(recording, t, :hold) == n)
    end

    test "stays at the end, or starts again one period after it", %{recording: recording} do
      assert shown(recording, 100, :hold) == 3
      assert shown(recording, 3.9, :loop) == 3
      assert shown(recording, 4.0, :loop) == 0
      assert shown(recording, 9.5, :loop) == 1
    end
  end
end

defmodule BB.Handoff.Encoding.TagDetectionsTest do
  use ExUnit.Case, async: true

  alias BB.Handoff.Encoding.TagDetections
  alias BB.Test.Vectors

  test "the vector that all languages share decodes to its values" do
    before = BB.Ring.now_ns()
    assert {:ok, %{payload: found} = message} = TagDetections.decode(Vectors.read!("tags"))
    assert length(found.detections) == 2

    assert [
             %{family: "tag36h11", corners: [{_, _}, {_, _}, {_, _}, {_, _}], homography: [_ | _]} =
               first
             | _
           ] = found.detections

    assert {is_integer(first.id), is_float(first.decision_margin)} == {true, true}
    assert message.monotonic_time == found.capture_time

    # The capture is as long ago on Erlang's clock as on the ring's, less the time between two
    # reads.
    ring_age = before - capture_ns()
    erlang_age = System.monotonic_time(:nanosecond) - found.capture_time
    assert_in_delta ring_age, erlang_age, 60.0e9
  end

  test "a frame without tags is a message without detections, and an unknown speed is nil" do
    assert {:ok, %{payload: %{detections: [], angular_speed: nil}}} =
             TagDetections.decode(Vectors.read!("tags_none"))
  end

  test "a message without our tail is an error" do
    bytes = Vectors.read!("tags_none")

    assert {:error, {:truncated, _}} =
             TagDetections.decode(binary_part(bytes, 0, byte_size(bytes) - 1))
  end

  test "a tail of another kind is an error that names it" do
    bytes = "tags_none" |> Vectors.read!() |> String.replace("GNGT", "OTHR")
    assert {:error, {:unknown_tail, magic, 1}} = TagDetections.decode(bytes)
    assert <<magic::little-32>> == "OTHR"
  end

  # The capture time of the vector, where the tail has it: 24 bytes before the end.
  defp capture_ns do
    bytes = Vectors.read!("tags")
    <<time::little-64, _speed::64>> = binary_part(bytes, byte_size(bytes), -16)
    time
  end
end

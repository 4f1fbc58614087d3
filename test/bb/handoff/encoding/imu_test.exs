defmodule BB.Handoff.Encoding.ImuTest do
  use ExUnit.Case, async: true

  alias BB.Handoff.Encoding.Imu
  alias BB.Math.{Covariance3, Quaternion, Vec3}
  alias BB.Message.Sensor
  alias BB.Test.Vectors

  # The name in the vector is known to this node by this very atom.
  @frame_id :imu_link

  defp message(attrs) do
    defaults = [
      orientation: Quaternion.identity(),
      angular_velocity: Vec3.zero(),
      linear_acceleration: Vec3.zero()
    ]

    BB.Message.new!(Sensor.Imu, @frame_id, Keyword.merge(defaults, attrs),
      wall_time: 1_700_000_000_123_456_789
    )
  end

  test "the vector that all languages share decodes to its values" do
    assert {:ok, message} = Imu.decode(Vectors.read!("imu"))
    assert message.frame_id == @frame_id
    assert message.wall_time == 1_700_000_000_123_456_789
    assert message.payload.orientation == Quaternion.identity()
    assert message.payload.orientation_covariance == Covariance3.unavailable()
    assert message.payload.angular_velocity == Vec3.new(0.25, -1.5, 3.0)
    assert Covariance3.at(message.payload.angular_velocity_covariance, 1, 1) == 0.002
  end

  test "a decoded message encodes to the same bytes" do
    bytes = Vectors.read!("imu")
    {:ok, message} = Imu.decode(bytes)
    assert IO.iodata_to_binary(Imu.encode(message)) == bytes
  end

  test "an unknown covariance is encoded as zeros and decoded as nil" do
    {:ok, decoded} = message([]) |> Imu.encode() |> IO.iodata_to_binary() |> Imu.decode()
    assert decoded.payload == message([]).payload
  end

  test "the quaternion's order changes on the way: ROS has w last" do
    q = Quaternion.new(0.5, -0.5, 0.5, -0.5)
    bytes = IO.iodata_to_binary(Imu.encode(message(orientation: q)))
    assert {:ok, %{payload: %{orientation: ^q}}} = Imu.decode(bytes)
    # header: 4 encapsulation, 8 stamp, 4 length, 9 name, padding to 8
    assert <<_::binary-size(28), x::little-float, _::128, w::little-float, _::binary>> = bytes
    assert {x, w} == {-0.5, 0.5}
  end

  test "a frame that is no atom here becomes :unknown" do
    bytes =
      message([])
      |> Imu.encode()
      |> IO.iodata_to_binary()
      |> String.replace("imu_link", "no_such_")

    assert {:ok, %{frame_id: :unknown}} = Imu.decode(bytes)
  end

  test "half a message is an error" do
    assert {:error, {:truncated, _}} = Imu.decode(binary_part(Vectors.read!("imu"), 0, 100))
  end
end

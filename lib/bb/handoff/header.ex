defmodule BB.Handoff.Header do
  @moduledoc """
  `std_msgs/msg/Header`, the start of every stamped ROS 2 message: seconds and nanoseconds of wall time, and a frame's name.
  """

  @second 1_000_000_000

  @doc "Its type for `BB.Handoff.Cdr`."
  @spec type() :: [BB.Handoff.Cdr.type()]
  def type, do: [:i32, :u32, :string]

  @doc """
  Its values for a wall time in nanoseconds.

      iex> BB.Handoff.Header.values(1_700_000_000_123_456_789, :imu)
      [1_700_000_000, 123_456_789, "imu"]
  """
  @spec values(integer(), atom()) :: [integer() | String.t()]
  def values(wall_time, frame_id) do
    [
      Integer.floor_div(wall_time, @second),
      Integer.mod(wall_time, @second),
      Atom.to_string(frame_id)
    ]
  end

  @doc """
  Wall time in nanoseconds and frame. A name that is no atom of this node becomes `:unknown`: what comes from outside makes no atoms.

      iex> BB.Handoff.Header.parse([1, 5, "imu"])
      {1_000_000_005, :imu}
  """
  @spec parse([integer() | String.t()]) :: {integer(), atom()}
  def parse([seconds, nanoseconds, frame_id]),
    do: {seconds * @second + nanoseconds, known_atom(frame_id)}

  defp known_atom(name) do
    String.to_existing_atom(name)
  rescue
    ArgumentError -> :unknown
  end
end

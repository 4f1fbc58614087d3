defmodule BB.Handoff.Encoding do
  @moduledoc """
  The behaviour of an encoding: how a payload is written to a ring topic and read from it.

  Implement it for a payload of your own that an outlet or an inlet carries.
  `BB.Handoff.Encoding.Imu` and `BB.Handoff.Encoding.TagDetections` ship with Ganglion.

      defmodule MyRobot.RangeEncoding do
        @behaviour BB.Handoff.Encoding

        alias BB.Message.Sensor.Range

        @impl BB.Handoff.Encoding
        def content, do: "my_robot/range"

        @impl BB.Handoff.Encoding
        def payload, do: Range

        @impl BB.Handoff.Encoding
        def encode(message), do: <<message.payload.range::little-float-64>>
      end

  The topic carries the encoding's name as its content tag, by which tools and programs in other
  languages know the encoding.

  ## Stamped ROS 2 messages

  Stamped ROS 2 messages begin with a `std_msgs/msg/Header`: seconds and nanoseconds of wall time,
  and the name of a frame. `header_type/0`, `header_values/2` and `parse_header/1` are for
  encodings of such messages by `BB.Handoff.Cdr`.
  """

  alias BB.Handoff.Cdr

  @second_ns 1_000_000_000

  @doc "Returns the encoding's name, such as `\"sensor_msgs/msg/Imu\"`."
  @callback content() :: String.t()

  @doc "Returns the module of the payload."
  @callback payload() :: module()

  @doc "Encodes a message. An outlet calls it."
  @callback encode(BB.Message.t()) :: iodata()

  @doc "Decodes a message. An inlet calls it."
  @callback decode(binary()) :: {:ok, BB.Message.t()} | {:error, reason :: term()}

  @optional_callbacks encode: 1, decode: 1

  @doc "Returns the type of a `std_msgs/msg/Header` for `BB.Handoff.Cdr`."
  @spec header_type() :: [Cdr.type()]
  def header_type, do: [:i32, :u32, :string]

  @doc """
  Returns the values of a header, for a wall time in nanoseconds.

      iex> BB.Handoff.Encoding.header_values(1_700_000_000_123_456_789, :imu)
      [1_700_000_000, 123_456_789, "imu"]
  """
  @spec header_values(integer(), atom()) :: [integer() | String.t()]
  def header_values(wall_time, frame_id) do
    [
      Integer.floor_div(wall_time, @second_ns),
      Integer.mod(wall_time, @second_ns),
      Atom.to_string(frame_id)
    ]
  end

  @doc """
  Returns the wall time in nanoseconds and the frame of a header's values.

  A name that is no atom of this node becomes `:unknown`, since data from outside makes no atoms.

      iex> BB.Handoff.Encoding.parse_header([1, 5, "imu"])
      {1_000_000_005, :imu}
  """
  @spec parse_header([integer() | String.t()]) :: {integer(), atom()}
  def parse_header([seconds, nanoseconds, frame_id]),
    do: {seconds * @second_ns + nanoseconds, existing_atom(frame_id)}

  defp existing_atom(name) do
    String.to_existing_atom(name)
  rescue
    ArgumentError -> :unknown
  end
end

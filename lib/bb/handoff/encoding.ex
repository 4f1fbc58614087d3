defmodule BB.Handoff.Encoding do
  @moduledoc """
  How a payload travels through the ring.

  An encoding has a name, which the topic carries as its content tag, so that tools and processes in other languages know what is inside.
  Those that ship are `BB.Handoff.Encoding.Imu` and `BB.Handoff.Encoding.TagDetections`; a robot's own is a module with these callbacks.
  """

  @doc "Its name, such as `\"sensor_msgs/msg/Imu\"`."
  @callback content() :: String.t()

  @doc "The payload's module."
  @callback payload() :: module()

  @doc "The bytes of a message. For encodings that an outlet uses."
  @callback encode(BB.Message.t()) :: iodata()

  @doc "The message of the bytes. For encodings that an inlet uses."
  @callback decode(binary()) :: {:ok, BB.Message.t()} | {:error, reason :: term()}

  @optional_callbacks encode: 1, decode: 1
end

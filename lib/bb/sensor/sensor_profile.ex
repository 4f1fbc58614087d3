defmodule BB.Sensor.SensorProfile do
  @moduledoc """
  What a sensor's place on the robot means for it, given to `init` as `opts[:sensor_profile]`.

    * `:joint_name` - the joint it is attached to, `nil` elsewhere
    * `:transmission` - what is between the sensor and the joint, a `BB.Transmission`; `nil` when it measures the joint itself
  """

  defstruct [:joint_name, :transmission]

  @type t :: %__MODULE__{joint_name: atom() | nil, transmission: BB.Transmission.t() | nil}
end

defmodule BB.Sensor.SensorProfile do
  @moduledoc """
  The place of a sensor on its robot: its joint and its transmission.

  The driver's `init/1` receives it as an option:

      def init(opts) do
        %BB.Sensor.SensorProfile{joint_name: joint} = opts[:sensor_profile]
        {:ok, %{joint: joint}}
      end

    * `:joint_name` - the joint to which the sensor is attached, or `nil`
    * `:transmission` - the gears between the sensor and the joint, a `BB.Transmission`; `nil`
      when the sensor measures the joint itself
  """

  defstruct [:joint_name, :transmission]

  @type t :: %__MODULE__{joint_name: atom() | nil, transmission: BB.Transmission.t() | nil}
end

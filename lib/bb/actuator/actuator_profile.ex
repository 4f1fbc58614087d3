defmodule BB.Actuator.ActuatorProfile do
  @moduledoc """
  The place of an actuator on its robot: its joint and its transmission.

  The driver's `init/1` receives it as an option:

      def init(opts) do
        %BB.Actuator.ActuatorProfile{joint_name: joint} = opts[:actuator_profile]
        {:ok, %{joint: joint}}
      end

    * `:joint_name` - the joint that the actuator moves
    * `:transmission` - the gears between the motor and the joint, a `BB.Transmission`; `nil` when
      the actuator moves the joint itself
  """

  defstruct [:joint_name, :transmission]

  @type t :: %__MODULE__{joint_name: atom() | nil, transmission: BB.Transmission.t() | nil}
end

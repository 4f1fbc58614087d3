defmodule BB.Actuator.ActuatorProfile do
  @moduledoc """
  What an actuator's place on the robot means for it, given to `init` as `opts[:actuator_profile]`.

    * `:joint_name` - the joint that it moves
    * `:transmission` - what is between the motor and the joint, a `BB.Transmission`; `nil` when it moves the joint itself
  """

  defstruct [:joint_name, :transmission]

  @type t :: %__MODULE__{joint_name: atom() | nil, transmission: BB.Transmission.t() | nil}
end

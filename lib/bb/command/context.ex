defmodule BB.Command.Context do
  @moduledoc """
  What an execution of a command is given of its robot: the second argument of
  `c:BB.Command.handle_command/3`, and `opts[:context]` of `c:BB.Command.init/1`.

      def handle_command(_goal, %BB.Command.Context{robot_module: robot}, state) do
        :ok = BB.Actuator.set_position(robot, :arm, 0.5)
        {:noreply, state}
      end

  ## Fields

    * `:robot_module` - the robot's module
    * `:robot` - its description with the values of the parameters at the start of the execution
      (`BB.Robot.Runtime.get_robot/1`)
    * `:robot_state` - the positions of its joints, which follow the sensors
      (`BB.Robot.Runtime.get_robot_state/1`)
    * `:execution_id` - the reference of this execution, the last segment of its events' path
  """

  @enforce_keys [:robot_module, :execution_id]
  defstruct [:robot_module, :robot, :robot_state, :execution_id]

  @type t :: %__MODULE__{
          robot_module: module(),
          robot: BB.Robot.t() | nil,
          robot_state: BB.Robot.State.t() | nil,
          execution_id: reference()
        }
end

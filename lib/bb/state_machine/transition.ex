defmodule BB.StateMachine.Transition do
  @moduledoc """
  The payload for a change of a robot's state, published on `[:state_machine]`: of its safety
  state by `BB.Safety`, and of its operational state (`BB.Robot.Runtime.state/1`) while the robot
  is armed.

      {:ok, _} = BB.subscribe(MyRobot, [:state_machine])

      receive do
        {:bb, [:state_machine], %{payload: %BB.StateMachine.Transition{to: :armed}}} -> :armed
      end
  """

  defstruct [:from, :to]

  @typedoc """
  A safety state, `:disarmed`, `:armed`, `:disarming` or `:error`, or an operational state:
  `:idle`, `:executing` or one of the robot's `states`.
  """
  @type state :: atom()
  @type t :: %__MODULE__{from: state(), to: state()}

  use BB.Message,
    schema: [
      from: [type: :atom, required: true, doc: "The state before."],
      to: [type: :atom, required: true, doc: "The state after."]
    ]
end

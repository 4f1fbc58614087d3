defmodule BB.StateMachine.Transition do
  @moduledoc """
  The payload for a change of a robot's safety state. `BB.Safety` publishes it on
  `[:state_machine]`.

      {:ok, _} = BB.subscribe(MyRobot, [:state_machine])

      receive do
        {:bb, [:state_machine], %{payload: %BB.StateMachine.Transition{to: :armed}}} -> :armed
      end
  """

  @states [:disarmed, :armed, :disarming, :error]

  defstruct [:from, :to]

  @type state :: :disarmed | :armed | :disarming | :error
  @type t :: %__MODULE__{from: state(), to: state()}

  use BB.Message,
    schema: [
      from: [type: {:in, @states}, required: true, doc: "The state before."],
      to: [type: {:in, @states}, required: true, doc: "The state after."]
    ]
end

defmodule BB.StateMachine.Transition do
  @moduledoc "A robot went from one safety state to another. Published on `[:state_machine]`."

  @states [:disarmed, :armed, :disarming, :error]

  defstruct [:from, :to]

  @type state :: :disarmed | :armed | :disarming | :error
  @type t :: %__MODULE__{from: state(), to: state()}

  use BB.Message,
    schema: [
      from: [type: {:in, @states}, required: true, doc: "The state that it left."],
      to: [type: {:in, @states}, required: true, doc: "The state that it is in."]
    ]
end

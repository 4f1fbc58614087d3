defmodule BB.Command.Event do
  @moduledoc """
  The payload for the beginning and the end of an execution of a command.
  `BB.Robot.Runtime.execute/3` starts an execution; its events are published on
  `[:command, name, execution_id]`. Subscribe to follow commands that other processes execute:

      {:ok, _} = BB.subscribe(MyRobot, [:command, :wave])

      receive do
        {:bb, [:command, :wave, _id], %{payload: %BB.Command.Event{status: :succeeded}}} -> :waved
      end

  | status | data |
  |---|---|
  | `:started` | `%{goal: map}` |
  | `:succeeded` | `%{result: term}` |
  | `:failed` | `%{reason: term}` |
  """

  @statuses [:started, :succeeded, :failed]

  defstruct [:status, data: %{}]

  @type t :: %__MODULE__{status: :started | :succeeded | :failed, data: map()}

  use BB.Message,
    schema: [
      status: [type: {:in, @statuses}, required: true, doc: "What has happened."],
      data: [type: :any, default: %{}, doc: "The goal, the result or the reason."]
    ]
end

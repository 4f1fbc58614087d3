defmodule BB.Command.SetState do
  @moduledoc """
  The handler of a command that changes the operational state of the robot. Use it to let people
  switch between the states of a robot.

      command :record do
        handler {BB.Command.SetState, to: :recording}
        allowed_states [:idle]
      end

  Its result is `{:ok, state, next_state: state}`.
  """

  use BB.Command,
    options_schema: [to: [type: :atom, required: true, doc: "The state, one of `states`."]]

  @impl BB.Command
  def handle_command(_goal, _context, state),
    do: {:stop, :normal, %{state | result: state.to, next_state: state.to}}

  @impl BB.Command
  def result(%{result: nil}), do: {:error, :interrupted}
  def result(%{result: to, next_state: to}), do: {:ok, to, next_state: to}
end

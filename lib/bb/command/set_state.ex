defmodule BB.Command.SetState do
  @moduledoc """
  The handler of a command that changes the operational state of the robot. Use it to let people
  switch between the states of a robot.

      command :record do
        handler {BB.Command.SetState, to: :recording}
        allowed_states [:idle]
      end

  Its result is `{:ok, state, next_state: state}`, or `{:error, %BB.Error.State.Invalid{}}` for a
  state that the robot does not have.
  """

  use BB.Command,
    options_schema: [to: [type: :atom, required: true, doc: "The state, one of `states`."]]

  alias BB.Dsl.Info
  alias BB.Error.State.Invalid

  @impl BB.Command
  def handle_command(_goal, %{robot_module: robot}, %{to: to} = state),
    do: {:stop, :normal, %{state | result: check(to, Info.state_names(robot)), next_state: to}}

  defp check(to, states),
    do: if(to in states, do: :ok, else: {:error, %Invalid{state: to, valid_states: states}})

  @impl BB.Command
  def result(%{result: :ok, next_state: to}), do: {:ok, to, next_state: to}
  def result(%{result: {:error, error}}), do: {:error, error}
  def result(%{result: nil}), do: {:error, :interrupted}
end

defmodule BB.Firmware.Board.Memory do
  @moduledoc """
  A board in the memory of a process. Use it in tests of code that calls a board.

      {:ok, memory} = BB.Firmware.Board.Memory.start_link(status: :unvalidated, tell: self())
      board = {BB.Firmware.Board.Memory, memory}

  The process of `tell:` receives `{BB.Firmware.Board.Memory, call}` for each call that changes
  the board: `:validate`, `:revert`, `:prevent_revert`, `:reboot`, `:init_complete`,
  `{:set_heart, heart}`, `{:clear_heart, heart}`. `answer/3` sets the result of a call.
  """

  use Agent

  @behaviour BB.Firmware.Board

  @doc """
  Starts a board.

  Options: `status:` (default: `:unvalidated`), `tell:` a process, `slot:` a string, and the maps
  `firmware:`, `other:` and `provisioned:`.
  """
  @spec start_link(keyword()) :: Agent.on_start()
  def start_link(opts \\ []) do
    opts =
      Keyword.validate!(opts,
        status: :unvalidated,
        tell: nil,
        slot: nil,
        firmware: %{},
        other: %{},
        provisioned: %{}
      )

    Agent.start_link(fn -> Map.new(opts) |> Map.merge(%{heart: nil, answers: %{}}) end)
  end

  @doc "Sets the result of `call`, which then has no effect. `nil` removes the result."
  @spec answer(pid(), atom(), term()) :: :ok
  def answer(memory, call, answer),
    do: Agent.update(memory, &put_in(&1, [:answers, call], answer))

  @doc "Returns the callback of the heart, or `nil`."
  @spec heart(pid()) :: BB.Firmware.Board.heart() | nil
  def heart(memory), do: Agent.get(memory, & &1.heart)

  @impl BB.Firmware.Board
  def ready(memory), do: Agent.get(memory, &(&1.answers[:ready] || :ok))

  @impl BB.Firmware.Board
  def validation_status(memory),
    do: Agent.get(memory, &(&1.answers[:validation_status] || &1.status))

  @impl BB.Firmware.Board
  def validate(memory),
    do: update(memory, :validate, :validate, &{:ok, %{&1 | status: :validated}})

  @impl BB.Firmware.Board
  def revert(memory), do: update(memory, :revert, :revert, &{:ok, &1})

  @impl BB.Firmware.Board
  def prevent_revert(memory),
    do: update(memory, :prevent_revert, :prevent_revert, &{:ok, %{&1 | other: %{}}})

  @impl BB.Firmware.Board
  def reboot(memory), do: update(memory, :reboot, :reboot, &{:ok, &1})

  @impl BB.Firmware.Board
  def init_complete(memory), do: update(memory, :init_complete, :init_complete, &{:ok, &1})

  @impl BB.Firmware.Board
  def set_heart(memory, heart) do
    update(memory, :set_heart, {:set_heart, heart}, fn state ->
      if state.heart in [nil, heart],
        do: {:ok, %{state | heart: heart}},
        else: {{:error, {:taken, state.heart}}, state}
    end)
  end

  @impl BB.Firmware.Board
  def clear_heart(memory, heart) do
    update(memory, :clear_heart, {:clear_heart, heart}, fn state ->
      {:ok, if(state.heart == heart, do: %{state | heart: nil}, else: state)}
    end)
  end

  @impl BB.Firmware.Board
  def firmware(memory), do: Agent.get(memory, & &1.firmware)

  @impl BB.Firmware.Board
  def slot(memory), do: Agent.get(memory, & &1.slot)

  @impl BB.Firmware.Board
  def other(memory), do: Agent.get(memory, & &1.other)

  @impl BB.Firmware.Board
  def provisioned(memory), do: Agent.get(memory, & &1.provisioned)

  defp update(memory, name, call, fun) do
    Agent.get_and_update(memory, fn state ->
      _ = state.tell && send(state.tell, {__MODULE__, call})
      if answer = state.answers[name], do: {answer, state}, else: fun.(state)
    end)
  end
end

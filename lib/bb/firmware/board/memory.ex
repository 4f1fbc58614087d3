defmodule BB.Firmware.Board.Memory do
  @moduledoc """
  A board in the memory of a process, for tests of what decides about a real one.

      {:ok, memory} = BB.Firmware.Board.Memory.start_link(status: :unvalidated, tell: self())
      board = {BB.Firmware.Board.Memory, memory}

  The process of `tell:` gets `{BB.Firmware.Board.Memory, call}` for each call that changes something: `:validate`, `:revert`,
  `:prevent_revert`, `:reboot`, `:init_complete`, `{:set_heart, heart}`, `{:clear_heart, heart}`.
  `answer/3` sets what a call returns from then on.
  """

  use Agent

  @behaviour BB.Firmware.Board

  @doc """
  Options: `status:` (`:unvalidated`), `tell:` a process, `slot:` a string, and the maps
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

  @doc "What `call` returns from now on, in the place of doing anything; `nil` takes that back."
  @spec answer(pid(), atom(), term()) :: :ok
  def answer(memory, call, answer),
    do: Agent.update(memory, &put_in(&1, [:answers, call], answer))

  @doc "The function that the pretended heart calls, `nil` when there is none."
  @spec heart(pid()) :: BB.Firmware.Board.heart() | nil
  def heart(memory), do: Agent.get(memory, & &1.heart)

  @impl BB.Firmware.Board
  def ready(memory), do: Agent.get(memory, &(&1.answers[:ready] || :ok))

  @impl BB.Firmware.Board
  def validation_status(memory),
    do: Agent.get(memory, &(&1.answers[:validation_status] || &1.status))

  @impl BB.Firmware.Board
  def validate(memory), do: act(memory, :validate, :validate, &{:ok, %{&1 | status: :validated}})

  @impl BB.Firmware.Board
  def revert(memory), do: act(memory, :revert, :revert, &{:ok, &1})

  @impl BB.Firmware.Board
  def prevent_revert(memory),
    do: act(memory, :prevent_revert, :prevent_revert, &{:ok, %{&1 | other: %{}}})

  @impl BB.Firmware.Board
  def reboot(memory), do: act(memory, :reboot, :reboot, &{:ok, &1})

  @impl BB.Firmware.Board
  def init_complete(memory), do: act(memory, :init_complete, :init_complete, &{:ok, &1})

  @impl BB.Firmware.Board
  def set_heart(memory, heart) do
    act(memory, :set_heart, {:set_heart, heart}, fn state ->
      if state.heart in [nil, heart],
        do: {:ok, %{state | heart: heart}},
        else: {{:error, {:taken, state.heart}}, state}
    end)
  end

  @impl BB.Firmware.Board
  def clear_heart(memory, heart) do
    act(memory, :clear_heart, {:clear_heart, heart}, fn state ->
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

  defp act(memory, name, call, fun) do
    Agent.get_and_update(memory, fn state ->
      _ = state.tell && send(state.tell, {__MODULE__, call})
      if answer = state.answers[name], do: {answer, state}, else: fun.(state)
    end)
  end
end

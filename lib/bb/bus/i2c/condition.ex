defmodule BB.Bus.I2C.Condition do
  @first_delay_ms 10
  @longest_delay_ms 100
  @alone 3
  @adapter_gone [errno: 9, errno: 19]

  @moduledoc """
  Whether a bus works, judged by what its transfers answer. Pure.

  One device that holds the bus is that device's trouble; a bus that is held whomever one asks is stuck. So a bus is stuck when transfers
  time out at two addresses, or #{@alone} times where only one is in use, with no answer from anybody between. A NAK is an answer: the
  wires work. Addresses that failed already while others answered say nothing new and do not count.

  A stuck bus is closed and opened again after #{@first_delay_ms} ms. Then transfers are tried, and as many timeouts as make sure (one at each of two addresses;
  one, where only one is in use) take it down again, for twice as long as before, to #{@longest_delay_ms} ms at most. That limit is short because it
  adds to a component's own wait (`BB.Component.Backoff`, 750 ms at most): all sensors of a bus are back within a second of its recovery.
  The first answer makes it well again.

  A bus whose adapter has gone (the kernel's EBADF and ENODEV) is down at once and opened again in the same rhythm.

      iex> condition = BB.Bus.I2C.Condition.new() |> BB.Bus.I2C.Condition.opened()
      iex> timeout = {:error, :timeout}
      iex> in_use = [0x40, 0x68]
      iex> condition = BB.Bus.I2C.Condition.heard(condition, 0x68, timeout, in_use, 1_000)
      iex> BB.Bus.I2C.Condition.ask(condition, 1_000)
      :transfer
      iex> condition = BB.Bus.I2C.Condition.heard(condition, 0x40, timeout, in_use, 1_020)
      iex> BB.Bus.I2C.Condition.ask(condition, 1_029)
      {:error, :timeout}
      iex> BB.Bus.I2C.Condition.ask(condition, 1_030)
      :open
  """

  defstruct phase: :closed,
            row: [],
            failing: [],
            delay_ms: nil,
            until_ms: nil,
            error: nil

  @typedoc """
  - `:closed`: not opened yet;
  - `:up`: it works;
  - `:down`: closed, until it is time to open it again;
  - `:trying`: open again, and nobody has answered yet.
  """
  @type phase :: :closed | :up | :down | :trying

  @type t :: %__MODULE__{
          phase: phase(),
          row: [address :: term()],
          failing: [address :: term()],
          delay_ms: pos_integer() | nil,
          until_ms: integer() | nil,
          error: term()
        }

  @doc "That of a bus which was never opened."
  @spec new() :: t()
  def new, do: %__MODULE__{}

  @doc "What to do for a transfer: make it, open the bus first, or refuse with the error that took the bus down."
  @spec ask(t(), now_ms :: integer()) :: :transfer | :open | {:error, term()}
  def ask(%{phase: phase}, _now_ms) when phase in [:up, :trying], do: :transfer
  def ask(%{phase: :closed}, _now_ms), do: :open
  def ask(%{phase: :down, until_ms: until_ms}, now_ms) when now_ms >= until_ms, do: :open
  def ask(%{phase: :down, error: error}, _now_ms), do: {:error, error}

  @doc "The bus was opened."
  @spec opened(t()) :: t()
  def opened(%{phase: :closed} = condition), do: %{condition | phase: :up}
  def opened(%{phase: :down} = condition), do: %{condition | phase: :trying}

  @doc "The bus could not be opened."
  @spec unopened(t(), error :: term(), now_ms :: integer()) :: t()
  def unopened(%{phase: :closed} = condition, _error, _now_ms), do: condition
  def unopened(%{phase: :down} = condition, error, now_ms), do: down(condition, error, now_ms)

  @doc "A transfer with an address gave an answer, while the addresses `in_use` are those of all who have the bus open."
  @spec heard(t(), address, answer :: term(), in_use :: [address], now_ms :: integer()) :: t()
        when address: term()
  def heard(condition, address, {:error, :timeout}, in_use, now_ms) do
    condition = silent(condition, address)
    if stuck?(condition, in_use), do: down(condition, :timeout, now_ms), else: condition
  end

  def heard(condition, _address, {:error, error}, _in_use, now_ms) when error in @adapter_gone,
    do: down(condition, error, now_ms)

  def heard(%{phase: :up, row: [], failing: []} = condition, _address, _answer, _in_use, _now_ms),
    do: condition

  def heard(condition, address, _answer, _in_use, _now_ms) do
    failing = Enum.uniq(condition.row ++ condition.failing) -- [address]
    %__MODULE__{phase: :up, failing: failing}
  end

  @doc "Whether something is wrong with the bus that has to be remembered also while nobody has it open."
  @spec troubled?(t()) :: boolean()
  def troubled?(%{phase: :up, row: []}), do: false
  def troubled?(%{phase: :closed}), do: false
  def troubled?(_condition), do: true

  # Of one that goes on alone no more has to be remembered than what makes sure.
  defp silent(condition, address) do
    if condition.phase == :up and address in condition.failing,
      do: condition,
      else: %{condition | row: Enum.take([address | condition.row], @alone)}
  end

  defp stuck?(%{row: []}, _in_use), do: false

  defp stuck?(condition, in_use) do
    several?(condition.row) or
      (only?(condition, in_use) and length(condition.row) >= enough(condition))
  end

  defp several?(row), do: match?([_, _ | _], Enum.uniq(row))
  defp only?(condition, in_use), do: (in_use -- condition.failing) -- condition.row == []

  defp enough(%{phase: :trying}), do: 1
  defp enough(%{phase: :up}), do: @alone

  defp down(condition, error, now_ms) do
    delay_ms = longer(condition.delay_ms)

    %__MODULE__{
      phase: :down,
      error: error,
      delay_ms: delay_ms,
      until_ms: now_ms + delay_ms
    }
  end

  defp longer(nil), do: @first_delay_ms
  defp longer(delay_ms), do: min(2 * delay_ms, @longest_delay_ms)
end

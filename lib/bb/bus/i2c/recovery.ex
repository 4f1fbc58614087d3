defmodule BB.Bus.I2C.Recovery do
  @first_delay_ms 10
  @longest_delay_ms 100
  @alone 3
  @adapter_gone [errno: 9, errno: 19]

  @moduledoc """
  Decides from the results of transfers when a bus is stuck, and when it is closed and reopened.

  `BB.Bus.I2C.Server` keeps one for its bus. The module is pure.

      iex> alias BB.Bus.I2C.Recovery
      iex> recovery = Recovery.new() |> Recovery.opened()
      iex> timeout = {:error, :timeout}
      iex> in_use = [0x40, 0x68]
      iex> recovery = Recovery.transferred(recovery, 0x68, timeout, in_use, 1_000)
      iex> Recovery.next_step(recovery, 1_000)
      :transfer
      iex> recovery = Recovery.transferred(recovery, 0x40, timeout, in_use, 1_020)
      iex> Recovery.next_step(recovery, 1_029)
      {:error, :timeout}
      iex> Recovery.next_step(recovery, 1_030)
      :open

  ## When a bus is stuck

  One device that holds the bus is a faulty device. A bus that times out at every address is
  stuck:

  - transfers time out at two addresses, or #{@alone} times where only one address is in use,
  - and no device answers in between. A NAK is an answer, because it shows that the wires work.

  An address that failed before, while others answered, does not count.

  ## How it is reopened

  A stuck bus is closed, and opened again after #{@first_delay_ms} ms. The next transfers then
  test it. The first answer makes the bus `:up`. Timeouts at two addresses, or one timeout where
  only one address is in use, close it again. Each delay is twice as long as the one before, up to
  #{@longest_delay_ms} ms. This limit is short because the restart delay of a component
  (`BB.Component.Backoff`, at most 750 ms) adds to it: all sensors of a bus work within a second
  of its recovery.

  A bus whose adapter is gone (the kernel's EBADF and ENODEV) is `:down` at once. It is reopened
  after the same delays.
  """

  defstruct phase: :closed,
            timeouts: [],
            failing: [],
            delay_ms: nil,
            until_ms: nil,
            error: nil

  @typedoc """
  The phase of a bus:

  - `:closed`: not opened yet;
  - `:up`: works;
  - `:down`: closed until its delay is over;
  - `:trying`: reopened, and no device has answered yet.
  """
  @type phase :: :closed | :up | :down | :trying

  @typedoc """
  The state of a bus.

  - `:timeouts`: the addresses of the last timeouts with no answer in between, the latest first;
  - `:failing`: the addresses that timed out before others answered;
  - `:delay_ms`, `:until_ms`: the current delay, and when it ends;
  - `:error`: the error that closed the bus.
  """
  @type t :: %__MODULE__{
          phase: phase(),
          timeouts: [address :: term()],
          failing: [address :: term()],
          delay_ms: pos_integer() | nil,
          until_ms: integer() | nil,
          error: term()
        }

  @doc "Returns the state of a bus that was never opened."
  @spec new() :: t()
  def new, do: %__MODULE__{}

  @doc """
  Returns what a transfer needs: nothing (`:transfer`), an open bus first (`:open`), or the error
  that closed the bus while its delay lasts.
  """
  @spec next_step(t(), now_ms :: integer()) :: :transfer | :open | {:error, term()}
  def next_step(%{phase: phase}, _now_ms) when phase in [:up, :trying], do: :transfer
  def next_step(%{phase: :closed}, _now_ms), do: :open
  def next_step(%{phase: :down, until_ms: until_ms}, now_ms) when now_ms >= until_ms, do: :open
  def next_step(%{phase: :down, error: error}, _now_ms), do: {:error, error}

  @doc "Records that the bus was opened."
  @spec opened(t()) :: t()
  def opened(%{phase: :closed} = recovery), do: %{recovery | phase: :up}
  def opened(%{phase: :down} = recovery), do: %{recovery | phase: :trying}

  @doc "Records that the bus could not be opened."
  @spec open_failed(t(), error :: term(), now_ms :: integer()) :: t()
  def open_failed(%{phase: :closed} = recovery, _error, _now_ms), do: recovery

  def open_failed(%{phase: :down} = recovery, error, now_ms),
    do: close_for_delay(recovery, error, now_ms)

  @doc """
  Records the result of a transfer with an address. `in_use` lists the addresses of all handles.
  """
  @spec transferred(t(), address, result :: term(), in_use :: [address], now_ms :: integer()) ::
          t()
        when address: term()
  def transferred(recovery, address, {:error, :timeout}, in_use, now_ms) do
    recovery = add_timeout(recovery, address)

    if stuck?(recovery, in_use),
      do: close_for_delay(recovery, :timeout, now_ms),
      else: recovery
  end

  def transferred(recovery, _address, {:error, error}, _in_use, now_ms)
      when error in @adapter_gone,
      do: close_for_delay(recovery, error, now_ms)

  def transferred(%{phase: :up, timeouts: [], failing: []} = recovery, _, _, _, _), do: recovery

  def transferred(recovery, address, _answer, _in_use, _now_ms) do
    failing = Enum.uniq(recovery.timeouts ++ recovery.failing) -- [address]
    %__MODULE__{phase: :up, failing: failing}
  end

  @doc "Returns whether the state has to be kept while no handle is open."
  @spec troubled?(t()) :: boolean()
  def troubled?(%{phase: :up, timeouts: []}), do: false
  def troubled?(%{phase: :closed}), do: false
  def troubled?(_recovery), do: true

  # A single address needs no more than @alone timeouts.
  defp add_timeout(recovery, address) do
    if recovery.phase == :up and address in recovery.failing,
      do: recovery,
      else: %{recovery | timeouts: Enum.take([address | recovery.timeouts], @alone)}
  end

  defp stuck?(%{timeouts: []}, _in_use), do: false

  defp stuck?(recovery, in_use) do
    several?(recovery.timeouts) or
      (only_address?(recovery, in_use) and length(recovery.timeouts) >= limit(recovery))
  end

  defp several?(addresses), do: match?([_, _ | _], Enum.uniq(addresses))

  defp only_address?(recovery, in_use),
    do: (in_use -- recovery.failing) -- recovery.timeouts == []

  defp limit(%{phase: :trying}), do: 1
  defp limit(%{phase: :up}), do: @alone

  defp close_for_delay(recovery, error, now_ms) do
    delay_ms = next_delay_ms(recovery.delay_ms)
    %__MODULE__{phase: :down, error: error, delay_ms: delay_ms, until_ms: now_ms + delay_ms}
  end

  defp next_delay_ms(nil), do: @first_delay_ms
  defp next_delay_ms(delay_ms), do: min(2 * delay_ms, @longest_delay_ms)
end

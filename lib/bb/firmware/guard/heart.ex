defmodule BB.Firmware.Guard.Heart do
  @moduledoc """
  What the VM's heart asks while a firmware is not yet validated: whether there is still time.

  The guard itself may hang or be gone. So the heart stops at the guard's deadline and a minute, which restarts the board, and with that the
  board takes the firmware before this one. `check/0` compares two numbers: a heart's callback that is slow or raises restarts the board too.
  """

  @grace_ms 60_000

  @doc "The callback, as `:heart.set_callback/2` takes it."
  @spec callback() :: {module(), :check}
  def callback, do: {__MODULE__, :check}

  @doc "Sets the time after which the heart stops: `deadline_ms` on the monotonic clock and a minute."
  @spec wind(integer()) :: :ok
  def wind(deadline_ms), do: :persistent_term.put(__MODULE__, deadline_ms + @grace_ms)

  @doc "What the heart calls."
  @spec check() :: :ok | :error
  def check, do: check(System.monotonic_time(:millisecond), :persistent_term.get(__MODULE__, nil))

  @doc """
  The same for a time and the time of the end.

      iex> BB.Firmware.Guard.Heart.check(100, 101)
      :ok
      iex> BB.Firmware.Guard.Heart.check(102, 101)
      :error
      iex> BB.Firmware.Guard.Heart.check(100, nil)
      :ok
  """
  @spec check(integer(), integer() | nil) :: :ok | :error
  def check(_now_ms, nil), do: :ok
  def check(now_ms, end_ms) when now_ms <= end_ms, do: :ok
  def check(_now_ms, _end_ms), do: :error
end

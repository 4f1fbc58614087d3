defmodule BB.Firmware.Guard.Heart do
  @moduledoc """
  The callback of the VM's heart while firmware is on trial. `BB.Firmware.Guard` sets it.

  The guard itself may hang or have ended. So the heart stops one minute after the guard's
  deadline. This restarts the board, which then starts the previous firmware. `check/0` only
  compares two numbers, because a callback that is slow or raises restarts the board too.
  """
  @moduledoc no_example: "internal: BB.Firmware.Guard is its interface"

  @grace_ms 60_000

  @doc "Returns the callback for `:heart.set_callback/2`."
  @spec callback() :: {module(), :check}
  def callback, do: {__MODULE__, :check}

  @doc """
  Sets the time at which the heart stops: one minute after `deadline_ms` on the monotonic clock.
  """
  @spec wind(integer()) :: :ok
  def wind(deadline_ms), do: :persistent_term.put(__MODULE__, deadline_ms + @grace_ms)

  @doc "Returns `:error` once the time is over. The heart calls it."
  @spec check() :: :ok | :error
  def check, do: check(System.monotonic_time(:millisecond), :persistent_term.get(__MODULE__, nil))

  @doc """
  Compares a time with the time at which the heart stops.

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

defmodule BB.Firmware.Gate.Lock do
  @moduledoc """
  The lock for writing a firmware, as a pure state machine: one holder at a time, and no holder
  after a firmware was written. `BB.Firmware.Gate.LockServer` has the lock.

      :free ── enter ─► {:held, holder} ── left ─► {:closing, until_ms} ── that time ─► :free
                             │                         │
                             └───────── written ───────┴─► :written

      iex> BB.Firmware.Gate.Lock.enter(:free, self(), 0)
      {:ok, {:held, self()}}
      iex> BB.Firmware.Gate.Lock.enter(:written, self(), 0)
      {:error, :written}

  The uploading process ends half a second before the success of its upload is reported. A second
  upload in between would overwrite the running firmware. So the lock stays closed for `settle_ms`
  after its holder has left. An uploader within that time waits (`:closing`), until it is known
  whether the firmware was written.
  """

  @type t :: :free | {:held, pid()} | {:closing, until_ms :: integer()} | :written
  @type refusal :: :updating | :closing | :written

  @doc "Gives the lock to an uploader, or returns the reason of the refusal."
  @spec enter(t(), pid(), integer()) :: {:ok, t()} | {:error, refusal()}
  def enter(:free, holder, _now_ms), do: {:ok, {:held, holder}}

  def enter({:closing, until_ms}, holder, now_ms) when now_ms >= until_ms,
    do: {:ok, {:held, holder}}

  def enter({:closing, _until_ms}, _holder, _now_ms), do: {:error, :closing}
  def enter(:written, _holder, _now_ms), do: {:error, :written}
  def enter(_lock, _holder, _now_ms), do: {:error, :updating}

  @doc "Handles the end of a process, which closes the lock if the process is its holder."
  @spec handle_down(t(), pid(), integer(), settle_ms :: non_neg_integer()) :: t()
  def handle_down({:held, holder}, holder, now_ms, settle_ms), do: {:closing, now_ms + settle_ms}
  def handle_down(lock, _other, _now_ms, _settle_ms), do: lock

  @doc "Frees a lock whose settling time is over."
  @spec handle_timeout(t(), integer()) :: t()
  def handle_timeout({:closing, until_ms}, now_ms) when now_ms >= until_ms, do: :free
  def handle_timeout(lock, _now_ms), do: lock

  @doc "Closes the lock for good, because the firmware was written and the board restarts."
  @spec written(t()) :: t()
  def written(_lock), do: :written
end

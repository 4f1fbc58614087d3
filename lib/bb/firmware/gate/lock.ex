defmodule BB.Firmware.Gate.Lock do
  @moduledoc """
  Who may write a firmware, as a pure state machine: one at a time, and nobody after one that succeeded.

      :free ── enter ─► {:held, holder} ── left ─► {:closing, until_ms} ── that time ─► :free
                             │                         │
                             └───────── written ───────┴─► :written

  The process that uploads ends before the firmware's success is told, by half a second. What a second upload would then write
  over is the running firmware; so the lock stays closed for `settle_ms` after its holder has
  left. Who comes within that time waits (`:closing`): nothing is written then, and soon it is
  known whether anything was. `BB.Firmware.Gate.LockServer` has it.
  """

  @type t :: :free | {:held, pid()} | {:closing, until_ms :: integer()} | :written
  @type refusal :: :updating | :closing | :written

  @doc "An uploader asks to enter."
  @spec enter(t(), pid(), integer()) :: {:ok, t()} | {:error, refusal()}
  def enter(:free, holder, _now_ms), do: {:ok, {:held, holder}}

  def enter({:closing, until_ms}, holder, now_ms) when now_ms >= until_ms,
    do: {:ok, {:held, holder}}

  def enter({:closing, _until_ms}, _holder, _now_ms), do: {:error, :closing}
  def enter(:written, _holder, _now_ms), do: {:error, :written}
  def enter(_lock, _holder, _now_ms), do: {:error, :updating}

  @doc "A process has left. Only the holder's leaving changes anything."
  @spec left(t(), pid(), integer(), settle_ms :: non_neg_integer()) :: t()
  def left({:held, holder}, holder, now_ms, settle_ms), do: {:closing, now_ms + settle_ms}
  def left(lock, _other, _now_ms, _settle_ms), do: lock

  @doc "Time has passed."
  @spec passed(t(), integer()) :: t()
  def passed({:closing, until_ms}, now_ms) when now_ms >= until_ms, do: :free
  def passed(lock, _now_ms), do: lock

  @doc "A firmware was written in full: the board restarts."
  @spec written(t()) :: t()
  def written(_lock), do: :written
end

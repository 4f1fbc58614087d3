defmodule BB.Firmware.Network.Operator do
  @moduledoc """
  The watchdog for the operator of an armed robot. Pure; the clock is an argument, in
  milliseconds. `BB.Firmware.Network` runs it.

  The robot must be disarmed when no sign of life has come for `after_ms`, counted from the last
  sign or from the arming, whichever is later. `handle/4` repeats this every `after_ms` while
  the robot stays armed. A disarmed robot needs no operator, and neither does a robot with
  `after_ms` of `nil`.
  """
  @moduledoc no_example: "handle/4 has an example"

  defstruct [:after_ms, :since_ms]

  @type t :: %__MODULE__{after_ms: pos_integer() | nil, since_ms: integer() | nil}
  @type event :: :sign | :tick

  @doc "Makes a watchdog with a timeout in milliseconds, or `nil` for none."
  @spec new(pos_integer() | nil) :: t()
  def new(after_ms), do: %__MODULE__{after_ms: after_ms}

  @doc """
  Handles an event, with the present state and time of the robot. Returns `:disarm` or `:nothing`.

      iex> alias BB.Firmware.Network.Operator
      iex> {operator, :nothing} = Operator.handle(Operator.new(2_000), :tick, true, 0)
      iex> {operator, :nothing} = Operator.handle(operator, :sign, true, 1_500)
      iex> {operator, :nothing} = Operator.handle(operator, :tick, true, 3_499)
      iex> {_operator, :disarm} = Operator.handle(operator, :tick, true, 3_500)
  """
  @spec handle(t(), event(), armed? :: boolean(), integer()) :: {t(), :disarm | :nothing}
  def handle(%{after_ms: nil} = operator, _event, _armed?, _now_ms), do: {operator, :nothing}
  def handle(operator, _event, false, _now_ms), do: {%{operator | since_ms: nil}, :nothing}
  def handle(operator, :sign, true, now_ms), do: {%{operator | since_ms: now_ms}, :nothing}

  def handle(%{since_ms: nil} = operator, :tick, true, now_ms),
    do: {%{operator | since_ms: now_ms}, :nothing}

  def handle(operator, :tick, true, now_ms) do
    if now_ms - operator.since_ms >= operator.after_ms,
      do: {%{operator | since_ms: now_ms}, :disarm},
      else: {operator, :nothing}
  end
end

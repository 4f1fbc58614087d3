defmodule BB.Firmware.Network.Operator do
  @moduledoc """
  Whether an armed robot has lost its operator. Pure; the clock is an argument, in milliseconds.

  An operator is heard by its signs of life. A robot that was armed and hears none for `after_ms`, counted from the last sign or from
  its arming, whichever is later, is to be disarmed; said again each `after_ms`, should it stay armed. A robot that is not
  armed needs no operator, and one that declares nothing (`after_ms` is `nil`) never does.
  """

  defstruct [:after_ms, :since_ms]

  @type t :: %__MODULE__{after_ms: pos_integer() | nil, since_ms: integer() | nil}
  @type event :: :sign | :tick

  @doc "For a robot that bears so many milliseconds without an operator."
  @spec new(pos_integer() | nil) :: t()
  def new(after_ms), do: %__MODULE__{after_ms: after_ms}

  @doc """
  What happened, whether the robot is armed now, and when: what follows is `:disarm` or `:nothing`.

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

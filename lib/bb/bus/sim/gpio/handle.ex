defmodule BB.Bus.Sim.GPIO.Handle do
  @moduledoc """
  A handle on lines of a simulated chip: how it was opened, and which process gets its edges.

  `BB.Bus.Sim.GPIO.Handles` opens and closes them. Bit 0 of a value is the first line's. The
  module is pure.

      iex> alias BB.Bus.Sim.GPIO.Handle
      iex> handle = %Handle{
      ...>   spec: [5, 6],
      ...>   offsets: [5, 6],
      ...>   direction: :output,
      ...>   pull: :none,
      ...>   drive: :push_pull,
      ...>   value: 0b10
      ...> }
      iex> {Handle.host(handle, 5), Handle.host(handle, 6)}
      {{:output, 0}, {:output, 1}}
  """
  import Bitwise

  @enforce_keys [:spec, :offsets, :direction, :pull, :drive, :value]
  defstruct [
    :spec,
    :offsets,
    :direction,
    :pull,
    :drive,
    :value,
    :owner,
    :receiver,
    :tag,
    trigger: :none,
    shadow: 0
  ]

  @typedoc "A handle. `:shadow` is the value after the last edge, `:owner` a monitor."
  @type t :: %__MODULE__{}

  @doc "Returns how the handle sets the pin of a line."
  @spec host(t(), non_neg_integer()) :: BB.Bus.Sim.GPIO.Line.host()
  def host(%{direction: :input}, _offset), do: :input

  def host(%{direction: :output} = handle, offset) do
    case {handle.drive, handle.value >>> index(handle, offset) &&& 1} do
      {:open_drain, 1} -> {:output, :z}
      {:open_source, 0} -> {:output, :z}
      {_drive, level} -> {:output, level}
    end
  end

  @doc "Returns the levels of its lines as one value."
  @spec value(t(), (non_neg_integer() -> 0 | 1)) :: non_neg_integer()
  def value(handle, level) do
    for {offset, index} <- Enum.with_index(handle.offsets), reduce: 0 do
      value -> value ||| level.(offset) <<< index
    end
  end

  @doc """
  Handles an edge on one of its lines.

  Returns the message for its receiver, or `nil`, and the handle.
  """
  @spec edge(t(), non_neg_integer(), 0 | 1, integer()) :: {term() | nil, t()}
  def edge(%{trigger: :none} = handle, _offset, _level, _time_ns), do: {nil, handle}

  def edge(handle, offset, level, time_ns) do
    bit = 1 <<< index(handle, offset)
    value = if level == 1, do: handle.shadow ||| bit, else: handle.shadow &&& bnot(bit)
    message = if wanted?(handle.trigger, level), do: message(handle, value, level, time_ns)
    {message, %{handle | shadow: value}}
  end

  defp message(%{tag: nil} = handle, _value, level, time_ns),
    do: {:circuits_gpio, handle.spec, time_ns, level}

  defp message(%{tag: {:tag, tag}} = handle, value, _level, time_ns) do
    change = %{ref: tag, timestamp: time_ns, value: value, previous_value: handle.shadow}
    {:circuits_gpio, change}
  end

  defp wanted?(:both, _level), do: true
  defp wanted?(:rising, level), do: level == 1
  defp wanted?(:falling, level), do: level == 0

  defp index(handle, offset), do: Enum.find_index(handle.offsets, &(&1 == offset))
end

defmodule BB.Bus.Sim.GPIO.Part do
  @moduledoc """
  A device that is plugged in somewhere: its model with its state and its pins. Pure but for the log entry of a model that raised.

  Each function gives what the device does besides, with lines in the place of pins: `{part, effects}`. A part outlives its
  device's wires: it stays when the device is unplugged.
  """
  require Logger

  @enforce_keys [:module, :opts, :pins, :state]
  defstruct [:module, :opts, :pins, :state, plugged?: true, broken?: false]

  @type t :: %__MODULE__{}

  @typedoc "A line of the part's chip."
  @type offset :: non_neg_integer()

  @doc "A device at power-on. `{:raise, exception}` when its model or its pins are wrong."
  @spec new(BB.Bus.Sim.Lines.device(), integer(), pos_integer()) ::
          {:ok, t(), [term()]} | {:raise, Exception.t()}
  def new({module, opts}, now_ns, count) do
    {pins, own} = Keyword.pop(opts, :pins, [])
    check_pins!(module, pins, count)
    {:ok, state, effects} = module.init(own, now_ns)
    part = %__MODULE__{module: module, opts: opts, pins: Map.new(pins), state: state}
    {:ok, part, wire(effects, part)}
  rescue
    exception -> {:raise, exception}
  catch
    kind, reason -> {:raise, BB.Bus.Sim.Device.not_made(module, kind, reason)}
  end

  @doc "The pin at a line; `nil` when it has none there."
  @spec pin(t(), offset()) :: atom() | nil
  def pin(%{plugged?: true, broken?: false, pins: pins}, offset),
    do: Enum.find_value(pins, fn {pin, at} -> if at == offset, do: pin end)

  def pin(_part, _offset), do: nil

  @doc "The level at one of its pins has changed."
  @spec level(t(), atom(), 0 | 1, integer()) :: {t(), [term()]}
  def level(part, pin, level, now_ns), do: call(part, :level, [pin, level, now_ns])

  @doc "The time for an event has come."
  @spec due(t(), term(), integer()) :: {t(), [term()]}
  def due(part, event, now_ns), do: call(part, :due, [event, now_ns])

  @doc "Somebody orders something: `:error` when the model does not know the order."
  @spec order(t(), term(), integer()) :: {t(), [term()]} | :error
  def order(part, order, now_ns) do
    if function_exported?(part.module, :order, 3),
      do: call(part, :order, [order, now_ns]),
      else: :error
  end

  defp call(part, function, arguments) do
    if function_exported?(part.module, function, length(arguments) + 1),
      do: run(part, function, arguments),
      else: {part, []}
  end

  defp run(part, function, arguments) do
    case apply(part.module, function, arguments ++ [part.state]) do
      {state, effects} when is_list(effects) -> {%{part | state: state}, wire(effects, part)}
      :error when function == :order -> :error
      other -> raise "expected {state, effects} of #{function}, got: #{inspect(other)}"
    end
  catch
    kind, reason ->
      Logger.error(
        "the simulated device #{inspect(part.module)} is broken until it is plugged in again: " <>
          Exception.format(kind, reason, __STACKTRACE__)
      )

      {%{part | broken?: true}, [:break]}
  end

  defp wire(effects, part), do: Enum.map(effects, &wire_one(&1, part))

  defp wire_one({:drive, pin, drive}, part), do: {:drive, Map.fetch!(part.pins, pin), drive}

  defp wire_one({:drive, pin, drive, time_ns}, part),
    do: {:drive, Map.fetch!(part.pins, pin), drive, time_ns}

  defp wire_one(effect, _part), do: effect

  defp check_pins!(module, pins, count) do
    _ = Code.ensure_loaded!(module)

    unless Enum.sort(Keyword.keys(pins)) == Enum.sort(module.pins()) and
             Enum.all?(Keyword.values(pins), &(&1 in 0..(count - 1))) do
      raise ArgumentError,
            "expected pins: a line below #{count} for each of #{inspect(module.pins())}, got: #{inspect(pins)}"
    end
  end
end

defmodule BB.Bus.Sim.GPIO.Part do
  @moduledoc """
  A device that was plugged in to a simulated chip: its model with its state and its pins.

  `BB.Bus.Sim.GPIO.Chip` has one for each device. A part stays when its device is unplugged.
  Functions return `{part, effects}`, with lines in the place of pins. The module is pure, except
  that it logs a model that raises.
  """
  @moduledoc no_example: "internal: BB.Bus.Sim.Lines is its interface"

  require Logger

  @enforce_keys [:module, :opts, :pins, :state]
  defstruct [:module, :opts, :pins, :state, plugged?: true, broken?: false]

  @typedoc "A part."
  @type t :: %__MODULE__{}

  @typedoc "The number of a line."
  @type offset :: non_neg_integer()

  @doc "Powers a device up. Returns `{:raise, exception}` when its options or pins are wrong."
  @spec new(BB.Bus.Sim.Lines.device(), integer(), pos_integer()) ::
          {:ok, t(), [term()]} | {:raise, Exception.t()}
  def new({module, opts}, now_ns, count) do
    {pins, own} = Keyword.pop(opts, :pins, [])
    check_pins!(module, pins, count)
    {:ok, state, effects} = module.init(own, now_ns)
    part = %__MODULE__{module: module, opts: opts, pins: Map.new(pins), state: state}
    {:ok, part, put_lines(effects, part)}
  rescue
    exception -> {:raise, exception}
  catch
    kind, reason -> {:raise, BB.Bus.Sim.Device.init_error(module, kind, reason)}
  end

  @doc "Returns the pin at a line, or `nil`."
  @spec pin(t(), offset()) :: atom() | nil
  def pin(%{plugged?: true, broken?: false, pins: pins}, offset),
    do: Enum.find_value(pins, fn {pin, at} -> if at == offset, do: pin end)

  def pin(_part, _offset), do: nil

  @doc "Passes a new level at one of its pins to the model."
  @spec level(t(), atom(), 0 | 1, integer()) :: {t(), [term()]}
  def level(part, pin, level, now_ns), do: call(part, :level, [pin, level, now_ns])

  @doc "Passes an event that is due to the model."
  @spec due(t(), term(), integer()) :: {t(), [term()]}
  def due(part, event, now_ns), do: call(part, :due, [event, now_ns])

  @doc "Passes an order to the model. Returns `:error` for an unknown one."
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
      {state, effects} when is_list(effects) -> {%{part | state: state}, put_lines(effects, part)}
      :error when function == :order -> :error
      other -> raise "expected {state, effects} of #{function}, got: #{inspect(other)}"
    end
  catch
    kind, reason ->
      Logger.error(
        "simulated device #{inspect(part.module)} is broken until it is plugged in again: " <>
          Exception.format(kind, reason, __STACKTRACE__)
      )

      {%{part | broken?: true}, [:break]}
  end

  defp put_lines(effects, part), do: Enum.map(effects, &put_line(&1, part))

  defp put_line({:drive, pin, drive}, part), do: {:drive, Map.fetch!(part.pins, pin), drive}

  defp put_line({:drive, pin, drive, time_ns}, part),
    do: {:drive, Map.fetch!(part.pins, pin), drive, time_ns}

  defp put_line(effect, _part), do: effect

  defp check_pins!(module, pins, count) do
    _ = Code.ensure_loaded!(module)

    unless Enum.sort(Keyword.keys(pins)) == Enum.sort(module.pins()) and
             Enum.all?(Keyword.values(pins), &(&1 in 0..(count - 1))) do
      raise ArgumentError,
            "expected pins: a line below #{count} for each of #{inspect(module.pins())}, " <>
              "got: #{inspect(pins)}"
    end
  end
end

defmodule BB.Bus.Sim.Interrupts do
  @moduledoc """
  The interrupt pins of a simulated bus's devices: what `c:BB.Bus.Sim.Device.pulses/3` says, on the lines, at its time.

  It belongs to the process of the bus, which is told `{:pulse, address}` when it is to call `follow/4` again.
  """

  alias BB.Bus.Sim.{Lines, Slot}
  alias BB.Clock

  @enforce_keys [:bus, :clock]
  defstruct [:bus, :clock, pins: %{}]

  @typedoc "For each address whose device pulses: its line, until when its pulses were made, and the timer of the next."
  @type t :: %__MODULE__{
          bus: String.t(),
          clock: Clock.t(),
          pins: %{
            byte() => %{
              line: term(),
              until_ns: integer(),
              next_ns: integer(),
              timer: Clock.timer()
            }
          }
        }

  @doc "Those of a bus where nobody pulses yet."
  @spec new(String.t(), Clock.t()) :: t()
  def new(bus, clock), do: %__MODULE__{bus: bus, clock: clock}

  @doc "Makes the pulses of a device that are due, and has the bus told of the next."
  @spec follow(t(), byte(), Slot.t() | nil) :: t()
  def follow(interrupts, address, slot) do
    now_ns = Clock.now_ns(interrupts.clock)
    pin = interrupts.pins[address]
    from_ns = if pin, do: pin.until_ns, else: now_ns

    case slot && Slot.pulses(slot, from_ns, now_ns) do
      nil -> quiet(interrupts, address, pin)
      pulses -> pulse(interrupts, address, pin, pulses, now_ns)
    end
  end

  defp quiet(interrupts, _address, nil), do: interrupts

  defp quiet(interrupts, address, pin) do
    _ = Clock.cancel(interrupts.clock, pin.timer)
    _ = Lines.release(pin.line, by: driver(interrupts, address))
    %{interrupts | pins: Map.delete(interrupts.pins, address)}
  end

  defp pulse(interrupts, address, pin, pulses, now_ns) do
    by = driver(interrupts, address)
    _ = if pin == nil, do: Lines.drive(pulses.line, 0, by: by)

    for time_ns <- pulses.times_ns do
      _ = Lines.drive(pulses.line, 1, by: by, at_ns: time_ns)
      _ = Lines.drive(pulses.line, 0, by: by, at_ns: time_ns + pulses.width_ns)
    end

    next = %{
      line: pulses.line,
      until_ns: now_ns,
      next_ns: pulses.next_ns,
      timer: arm(interrupts, address, pin, pulses.next_ns)
    }

    put_in(interrupts.pins[address], next)
  end

  defp arm(_interrupts, _address, %{next_ns: next_ns, timer: timer}, next_ns), do: timer

  defp arm(interrupts, address, pin, next_ns) do
    if pin, do: Clock.cancel(interrupts.clock, pin.timer)
    Clock.send_at(interrupts.clock, next_ns, self(), {:pulse, address})
  end

  defp driver(interrupts, address), do: {interrupts.bus, address}
end

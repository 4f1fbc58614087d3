defmodule BB.Bus.Sim.Interrupts do
  @moduledoc """
  Drives the interrupt pins of the devices on a simulated bus, as `c:BB.Bus.Sim.Device.pulses/3`
  returns their pulses.

  `BB.Bus.Sim.Server` has one for its bus. A timer sends it `{:pulse, address}`, upon which it
  calls `follow/3` again.
  """
  @moduledoc no_example: "internal: c:BB.Bus.Sim.Device.pulses/3 is its interface"

  alias BB.Bus.Sim.{Lines, Place}
  alias BB.Clock

  @enforce_keys [:bus, :clock]
  defstruct [:bus, :clock, pins: %{}]

  @typedoc """
  The pins of a bus. Each address whose device pulses has its line, the time up to which pulses
  were made, and the timer of the next pulse.
  """
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

  @doc "Returns the pins of a bus whose devices do not pulse yet."
  @spec new(String.t(), Clock.t()) :: t()
  def new(bus, clock), do: %__MODULE__{bus: bus, clock: clock}

  @doc "Makes the pulses of a device that are due, and starts the timer of the next one."
  @spec follow(t(), byte(), Place.t() | nil) :: t()
  def follow(interrupts, address, place) do
    now_ns = Clock.now_ns(interrupts.clock)
    pin = interrupts.pins[address]
    from_ns = if pin, do: pin.until_ns, else: now_ns

    case place && Place.pulses(place, from_ns, now_ns) do
      nil -> release(interrupts, address, pin)
      pulses -> pulse(interrupts, address, pin, pulses, now_ns)
    end
  end

  defp release(interrupts, _address, nil), do: interrupts

  defp release(interrupts, address, pin) do
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
      timer: start_timer(interrupts, address, pin, pulses.next_ns)
    }

    put_in(interrupts.pins[address], next)
  end

  defp start_timer(_interrupts, _address, %{next_ns: next_ns, timer: timer}, next_ns), do: timer

  defp start_timer(interrupts, address, pin, next_ns) do
    if pin, do: Clock.cancel(interrupts.clock, pin.timer)
    Clock.send_at(interrupts.clock, next_ns, self(), {:pulse, address})
  end

  defp driver(interrupts, address), do: {interrupts.bus, address}
end

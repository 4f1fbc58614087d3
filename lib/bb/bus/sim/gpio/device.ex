defmodule BB.Bus.Sim.GPIO.Device do
  @moduledoc """
  The behaviour of a simulated device on lines: a state machine that gets levels and time, and
  drives levels.

  Implement it to simulate a device, and plug the device in with `BB.Bus.Sim.Lines.plug/3`.

      defmodule Blinker do
        @behaviour BB.Bus.Sim.GPIO.Device

        @impl true
        def pins, do: [:lamp]

        @impl true
        def init(_opts, now_ns), do: {:ok, %{lit: 0}, [{:at, now_ns + 500_000_000, :turn}]}

        @impl true
        def due(:turn, now_ns, state) do
          lit = 1 - state.lit
          {%{state | lit: lit}, [{:drive, :lamp, lit}, {:at, now_ns + 500_000_000, :turn}]}
        end
      end

      :ok = BB.Bus.Sim.Lines.plug("gpiochip0", :blinker, {Blinker, pins: [lamp: 17]})

  A model is pure. It has no process and reads no clock: the chip keeps its state, passes the
  time, in nanoseconds of the chip's clock, and applies the effects that the model returns. A test
  calls a model directly, or steps the clock (`BB.Clock.Stepped`).

  A model describes a device that works. The lines add faults of wires
  (`BB.Bus.Sim.Lines.fault/2`).
  """

  alias BB.Bus.Sim.GPIO.Line

  @typedoc "The state of the model, which is opaque to the chip."
  @type state :: term()

  @typedoc "A pin of the device, by its name in the datasheet."
  @type pin :: atom()

  @typedoc """
  An effect of a device:

  - `{:drive, pin, drive}`: drives the line at a pin now, or with a fourth element at that time;
  - `{:at, time_ns, event}`: calls `c:due/3` with `event` at that time;
  - `:cancel`: drops the device's effects that are still to come.
  """
  @type effect ::
          {:drive, pin(), Line.drive()}
          | {:drive, pin(), Line.drive(), time_ns :: integer()}
          | {:at, time_ns :: integer(), event :: term()}
          | :cancel

  @doc "Returns the pins, which the option `:pins` connects to lines. The model does not get it."
  @callback pins() :: [pin(), ...]

  @doc "Returns the state at power-on, and its effects. Wrong options raise `ArgumentError`."
  @callback init(opts :: keyword(), now_ns :: integer()) :: {:ok, state(), [effect()]}

  @doc """
  Handles a new level of the line at one of its pins, which the device did not cause. Optional.
  """
  @callback level(pin(), Line.level(), now_ns :: integer(), state()) :: {state(), [effect()]}

  @doc "Handles the event of an effect `{:at, time_ns, event}`, at exactly that time. Optional."
  @callback due(event :: term(), now_ns :: integer(), state()) :: {state(), [effect()]}

  @doc """
  Handles an order of `BB.Bus.Sim.Lines.tell/3`, such as `:press`. Optional.

  Returns `:error` for an unknown order.
  """
  @callback order(term(), now_ns :: integer(), state()) :: {state(), [effect()]} | :error

  @optional_callbacks level: 4, due: 3, order: 3
end

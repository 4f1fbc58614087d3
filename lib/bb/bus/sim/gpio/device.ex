defmodule BB.Bus.Sim.GPIO.Device do
  @moduledoc """
  What a simulated device on lines is: a state machine that sees levels and time, and drives levels.

  A model is pure. It has no process and asks no clock: it is told the time, in nanoseconds of its chip's clock, and says what is to
  happen at which time. So a model is tested by calling it, and time may be real or stepped (`BB.Clock.Stepped`).

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

  Faults of wires are the lines' business (`BB.Bus.Sim.Lines.fault/2`): a model describes a device that works.
  """

  alias BB.Bus.Sim.GPIO.Line

  @typedoc "The state of the model; the chip does not look into it."
  @type state :: term()

  @typedoc "One of the device's own pins, by the name that its datasheet gives it."
  @type pin :: atom()

  @typedoc """
  What a device does:

  - `{:drive, pin, drive}`: now, or with a fourth element at that time;
  - `{:at, time_ns, event}`: is told `event` then, by `c:due/3`;
  - `:cancel`: what it has said before for later is not to happen.
  """
  @type effect ::
          {:drive, pin(), Line.drive()}
          | {:drive, pin(), Line.drive(), time_ns :: integer()}
          | {:at, time_ns :: integer(), event :: term()}
          | :cancel

  @doc "The pins to which lines are connected by the option `:pins`, which the model does not get."
  @callback pins() :: [pin(), ...]

  @doc "The state at power-on, with what `plug` was given. Wrong options raise `ArgumentError`."
  @callback init(opts :: keyword(), now_ns :: integer()) :: {:ok, state(), [effect()]}

  @doc "The level of the line at one of its pins has changed, by somebody else's doing. By default nothing follows."
  @callback level(pin(), Line.level(), now_ns :: integer(), state()) :: {state(), [effect()]}

  @doc "The time for which it said `{:at, time_ns, event}` has come; `now_ns` is exactly that time."
  @callback due(event :: term(), now_ns :: integer(), state()) :: {state(), [effect()]}

  @doc "Somebody presses, turns or moves it (`BB.Bus.Sim.Lines.tell/3`). `:error` where it knows no such order."
  @callback order(term(), now_ns :: integer(), state()) :: {state(), [effect()]} | :error

  @optional_callbacks level: 4, due: 3, order: 3
end

defmodule BB.Bus.Sim.Device do
  @moduledoc """
  What a simulated I2C device is: a state machine that bytes are written to and read from.

  A model is pure. It has no process and asks no clock: the bus gives it the time of each transfer, in nanoseconds of the bus's
  own clock, and keeps its state. So a model is tested by calling it, and a test that steps time needs nothing from it.

      defmodule MyChip do
        @behaviour BB.Bus.Sim.Device

        @impl true
        def init(opts, _now_ns), do: {:ok, %{registers: %{0 => opts[:id]}, pointer: 0}}

        @impl true
        def write(<<pointer>>, _now_ns, chip), do: {:ok, %{chip | pointer: pointer}}
        def write(<<_pointer, _value>>, _now_ns, chip), do: {:nak, chip}

        @impl true
        def read(count, _now_ns, chip) do
          bytes = for i <- 0..(count - 1), into: <<>>, do: <<Map.get(chip.registers, chip.pointer + i, 0)>>
          {:ok, bytes, chip}
        end
      end

  A transfer that writes and then reads (`write_read/4` of the bus) is `c:write/3` followed by `c:read/3` at the same time.
  Faults are the bus's business (`BB.Bus.Sim.fault/3`): a model describes a chip that works.
  """

  @typedoc "The state of the model; the bus does not look into it."
  @type state :: term()

  @doc "The state at power-on, with what `plug` was given. Wrong options raise `ArgumentError`; what the world lacks is `{:error, reason}`."
  @callback init(opts :: keyword(), now_ns :: integer()) :: {:ok, state()} | {:error, term()}

  @doc "The master wrote `data` (at least one byte). `{:nak, state}`: the device refuses."
  @callback write(data :: binary(), now_ns :: integer(), state()) ::
              {:ok, state()} | {:nak, state()}

  @doc "The master reads exactly `count` bytes (at least one)."
  @callback read(count :: pos_integer(), now_ns :: integer(), state()) ::
              {:ok, binary(), state()} | {:nak, state()}

  @doc """
  The pulses of the device's interrupt pin after `from_ns`, until `to_ns` and the one after that; `nil` while it makes none. The
  bus calls it after each transfer and at each pulse, and drives the line (`BB.Bus.Sim.Lines.drive/3`).
  """
  @callback pulses(from_ns :: integer(), to_ns :: integer(), state()) ::
              %{
                line: BB.Bus.Sim.GPIO.gpio_spec(),
                width_ns: pos_integer(),
                times_ns: [integer()],
                next_ns: integer()
              }
              | nil

  @optional_callbacks pulses: 3

  @doc "What a bus raises in its caller when a device's `init/2`, of I2C or of lines, threw or exited."
  @spec not_made(module(), :throw | :exit | :error, term()) :: Exception.t()
  def not_made(module, kind, reason) do
    why = Exception.format_banner(kind, reason)
    RuntimeError.exception("the simulated device #{inspect(module)} was not made: #{why}")
  end
end

defmodule BB.Bus.Sim.Device do
  @moduledoc """
  The behaviour of a simulated I2C device: a state machine that reads and writes bytes.

  Implement it to simulate a chip, and plug the chip in with `BB.Bus.Sim.plug/3`.

      defmodule MyChip do
        @behaviour BB.Bus.Sim.Device

        @impl true
        def init(opts, _now_ns), do: {:ok, %{registers: %{0 => opts[:id]}, pointer: 0}}

        @impl true
        def write(<<pointer>>, _now_ns, chip), do: {:ok, %{chip | pointer: pointer}}
        def write(<<_pointer, _value>>, _now_ns, chip), do: {:nak, chip}

        @impl true
        def read(count, _now_ns, chip) do
          registers = chip.pointer..(chip.pointer + count - 1)
          bytes = for i <- registers, into: <<>>, do: <<Map.get(chip.registers, i, 0)>>
          {:ok, bytes, chip}
        end
      end

  A model is pure. It has no process and reads no clock: the bus keeps its state, and passes the
  time of each transfer, in nanoseconds of the bus's clock. A test calls a model directly, or
  steps the clock.

  A transfer that writes and then reads (`write_read/4` of the bus) is `c:write/3` followed by
  `c:read/3` at the same time. A model describes a chip that works. The bus adds faults
  (`BB.Bus.Sim.fault/3`).
  """

  @typedoc "The state of the model, which is opaque to the bus."
  @type state :: term()

  @doc """
  Returns the state at power-on, for the options of `BB.Bus.Sim.plug/3`.

  Wrong options raise `ArgumentError`. Something missing, such as a file, is `{:error, reason}`.
  """
  @callback init(opts :: keyword(), now_ns :: integer()) :: {:ok, state()} | {:error, term()}

  @doc "Writes `data`, at least one byte. Returns `{:nak, state}` when the device refuses."
  @callback write(data :: binary(), now_ns :: integer(), state()) ::
              {:ok, state()} | {:nak, state()}

  @doc "Reads exactly `count` bytes, at least one."
  @callback read(count :: pos_integer(), now_ns :: integer(), state()) ::
              {:ok, binary(), state()} | {:nak, state()}

  @doc """
  Returns the pulses of the device's interrupt pin, or `nil` while it makes none.

  They are the pulses after `from_ns` up to `to_ns`, and the time of the next one. The bus calls
  it after each transfer and at each pulse, and drives the line (`BB.Bus.Sim.Lines.drive/3`).
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

  @doc "Returns the exception for a device whose `init/2` threw or exited."
  @spec init_error(module(), :throw | :exit | :error, term()) :: Exception.t()
  def init_error(module, kind, reason) do
    why = Exception.format_banner(kind, reason)
    RuntimeError.exception("could not start simulated device #{inspect(module)}: #{why}")
  end
end

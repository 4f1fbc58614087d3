defmodule BB.Bus.Sim.Lines do
  @moduledoc """
  Simulated GPIO chips, the devices on their lines, and faults of the lines.

  Use it in tests and demonstrations. It starts chips, plugs devices in and out, gives them orders
  such as `:press`, and cuts and shorts wires. Drivers use the lines through `BB.Bus.Sim.GPIO`,
  which has the interface of `Circuits.GPIO`.

      iex> devices = %{bumper: {BB.Bus.Sim.Contact, pins: [contact: 17]}}
      iex> {:ok, _pid} = BB.Bus.Sim.Lines.start_link(chips: %{"gpiochip7" => [devices: devices]})
      iex> {:ok, line} = BB.Bus.Sim.GPIO.open({"gpiochip7", 17}, :input, pull_mode: :pullup)
      iex> BB.Bus.Sim.GPIO.read(line)
      1
      iex> BB.Bus.Sim.Lines.tell("gpiochip7", :bumper, :press)
      iex> BB.Bus.Sim.GPIO.read(line)
      0
      iex> BB.Bus.Sim.Lines.fault({"gpiochip7", 17}, :cut)
      iex> BB.Bus.Sim.GPIO.read(line)
      1

  `BB.Bus.Sim.GPIO.Line` describes how the level of a line is decided.

  ## Breaking things

      # The pin has only its own pull.
      Lines.fault({"gpiochip0", 17}, :cut)
      # A short circuit to ground; 1: to the supply.
      Lines.fault({"gpiochip0", 17}, {:short, 0})
      # Noise with so many edges a second.
      Lines.fault({"gpiochip0", 17}, {:storm, 20_000})
      # Another program has the line: handles are closed, open/3 returns {:error, :already_open}.
      Lines.fault({"gpiochip0", 17}, :busy)
      Lines.clear({"gpiochip0", 17})

      # The device's wires are disconnected.
      Lines.unplug("gpiochip0", :bumper)
      # It is back, as after power-on.
      Lines.replug("gpiochip0", :bumper)

  ## Driving a line

  The simulation of a chip with an interrupt pin drives its line, with a driver name of its own. A
  drive with a time happens at that time, which is exactly the timestamp of its edge:

      at_ns = BB.Clock.now_ns(clock) + 1_000_000
      Lines.drive({"gpiochip0", 4}, 1, by: {"i2c-1", 0x68}, at_ns: at_ns)

  ## Time

  A chip has a clock, the machine's or a `BB.Clock.Stepped`. With a stepped clock, everything that
  is due within a step has happened in its order when `BB.Clock.Stepped.advance/3` returns, and
  the messages of all edges were sent. Name the processes that receive them in its `settle:`. With
  the machine's clock, things happen up to a millisecond late, with the timestamp at which they
  were due.
  """
  use Supervisor

  require BB.Bus.Sim.GPIO.Line

  alias BB.Bus.Sim.GPIO
  alias BB.Bus.Sim.GPIO.{Line, Server}

  # All chips end together with the registry that has their names.
  @restarts [max_restarts: 1_000, max_seconds: 1]

  @typedoc "The name of a chip, as on Linux: `\"gpiochip0\"`."
  @type name :: String.t()

  @typedoc """
  A device's model and its options.

  The option `:pins` connects its pins to lines: `pins: [trigger: 23, echo: 24]`.
  """
  @type device :: {module(), keyword()}

  @typedoc """
  The options of a chip:

  - `:lines`: the number of its lines; default 54;
  - `:devices`: the devices that are plugged in from the start, `%{name => device}`;
  - `:clock`: a `t:BB.Clock.t/0`; default `:real`;
  - `:label`: the chip's label, by default its name;
  - `:labels`: the labels of lines, `%{line => label}`;
  - `:timestamp_offset_ns`: the offset of timestamps from the clock, like that of the kernel's
    clock from Erlang's; default 0.
  """
  @type chip_options :: [
          lines: pos_integer(),
          devices: %{atom() => device()} | [{atom(), device()}],
          clock: BB.Clock.t(),
          label: String.t(),
          labels: %{non_neg_integer() => String.t()},
          timestamp_offset_ns: integer()
        ]

  @doc """
  Starts chips, linked to the caller: `chips: %{name => chip_options}`.

  Raises `ArgumentError` without the option `:chips`. A wrong option of a chip or of a device
  fails the start. A name that is taken is `{:already_started, pid}` in the supervisor's error.
  """
  @spec start_link(chips: %{name() => chip_options()} | [{name(), chip_options()}]) ::
          Supervisor.on_start()
  def start_link(opts), do: Supervisor.start_link(__MODULE__, chips!(opts))

  @doc """
  Returns the child specification of a set of chips.

  Its id has their names, so that one supervisor can have several sets.
  """
  @spec child_spec(keyword()) :: Supervisor.child_spec()
  def child_spec(opts) do
    %{
      id: {__MODULE__, Enum.map(chips!(opts), &elem(&1, 0))},
      start: {__MODULE__, :start_link, [opts]},
      type: :supervisor
    }
  end

  @impl Supervisor
  def init(chips) do
    chips
    |> Enum.map(fn {name, chip} -> Supervisor.child_spec({Server, {name, chip}}, id: name) end)
    |> Supervisor.init([strategy: :one_for_one] ++ @restarts)
  end

  @doc "Returns the names of the chips that run, sorted."
  @spec names() :: [name()]
  def names, do: Server.names()

  @doc """
  Returns the state of a line.

  It has the level at the pin (`:near`) and at the devices' end (`:far`), the `:fault` (or `nil`),
  and whether a handle is `:open?`.
  """
  @spec describe(GPIO.gpio_spec()) ::
          %{near: Line.level(), far: Line.level(), fault: Line.fault() | nil, open?: boolean()}
          | {:error, :not_found}
  def describe(spec), do: call(spec, &{:describe, &1})

  @doc "Returns the level of a line at the devices' end."
  @spec level(GPIO.gpio_spec()) :: Line.level() | {:error, :not_found}
  def level(spec) do
    with %{far: level} <- describe(spec), do: level
  end

  @doc """
  Drives a line from its far end: `0`, `1`, by a resistor (`:pullup`, `:pulldown`), or no more
  (`:z`).

  ## Options

  - `:by`: the driver, by default `:hand`. Several drivers of a line are independent;
  - `:at_ns`: a time of the chip's clock. It is the timestamp of the edge even if it has passed.
  """
  @spec drive(GPIO.gpio_spec(), Line.drive(), by: term(), at_ns: integer()) ::
          :ok | {:error, :not_found}
  def drive(spec, drive, opts \\ []) when Line.is_drive(drive) do
    opts = Keyword.validate!(opts, by: :hand, at_ns: nil)
    call(spec, &{:drive, &1, opts[:by], drive, opts[:at_ns]})
  end

  @doc "Lets a line go, and drops the drives of `by` that are still to come."
  @spec release(GPIO.gpio_spec(), by: term()) :: :ok | {:error, :not_found}
  def release(spec, opts \\ []) do
    [by: by] = Keyword.validate!(opts, by: :hand)
    call(spec, &{:release, &1, by})
  end

  @doc """
  Sets the fault of a line, in the place of an earlier one.

  Raises `ArgumentError` for a term that is no fault.
  """
  @spec fault(GPIO.gpio_spec(), Line.fault()) :: :ok | {:error, :not_found}
  def fault(spec, fault) do
    fault = Line.check_fault!(fault)
    call(spec, &{:fault, &1, fault})
  end

  @doc "Clears the fault of a line."
  @spec clear(GPIO.gpio_spec()) :: :ok | {:error, :not_found}
  def clear(spec), do: call(spec, &{:fault, &1, nil})

  @doc """
  Returns the devices of a chip, by name.

  Each has its `:module`, its `:pins`, whether it is `:plugged?`, and whether its model is
  `:broken?`. Unplugged devices are included.
  """
  @spec devices(name()) :: %{atom() => map()} | {:error, :not_found}
  def devices(chip), do: Server.call(chip, :devices)

  @doc """
  Plugs a new device in, powered up.

  The name of a device that is plugged in returns `{:error, :name_taken}`. Wrong options of the
  device raise the exception of its model.
  """
  @spec plug(name(), atom(), device()) :: :ok | {:error, :not_found | :name_taken}
  def plug(chip, name, {module, opts} = device) when is_atom(module) and is_list(opts) do
    case Server.call(chip, {:plug, name, device}) do
      {:raise, exception} -> raise exception
      answer -> answer
    end
  end

  @doc "Unplugs a device, which then drives nothing. Unplugging it again has no effect."
  @spec unplug(name(), atom()) :: :ok | {:error, :not_found | :no_device}
  def unplug(chip, name), do: Server.call(chip, {:unplug, name})

  @doc "Plugs a device in again, as after power-on. A device that is plugged in does not change."
  @spec replug(name(), atom()) :: :ok | {:error, :not_found | :no_device}
  def replug(chip, name), do: Server.call(chip, {:replug, name})

  @doc "Gives a device an order, such as `:press`. Its model documents its orders."
  @spec tell(name(), atom(), order :: term()) ::
          :ok | {:error, :not_found | :no_device | :unknown_order}
  def tell(chip, name, order), do: Server.call(chip, {:tell, name, order})

  defp call(spec, request) do
    with {:ok, {chip, offset}} <- GPIO.locate(spec), do: Server.call(chip, request.(offset))
  end

  defp chips!(opts) do
    case Keyword.fetch(opts, :chips) do
      {:ok, chips} when is_map(chips) or is_list(chips) ->
        Enum.map(chips, &chip!/1)

      _ ->
        raise ArgumentError, "expected chips: %{name => options}, got: #{inspect(opts)}"
    end
  end

  defp chip!({name, opts}) when is_binary(name) and is_list(opts), do: {name, opts}

  defp chip!(other) do
    raise ArgumentError,
          "expected a chip, such as {\"gpiochip0\", devices: …}, got: #{inspect(other)}"
  end
end

defmodule BB.Bus.Sim.Lines do
  @moduledoc """
  Simulated GPIO: chips with lines, what is wired to them, and a hand that presses, cuts and shorts.

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

  Drivers talk to lines by `BB.Bus.Sim.GPIO`, which is `Circuits.GPIO` in all that they can see. What decides a line's level is
  told by `BB.Bus.Sim.GPIO.Line`.

  ## Breaking things

      Lines.fault({"gpiochip0", 17}, :cut)            # the pin sees its own pull and nothing else
      Lines.fault({"gpiochip0", 17}, {:short, 0})     # to ground; 1: to the supply
      Lines.fault({"gpiochip0", 17}, {:storm, 20_000})  # noise: so many edges a second
      Lines.fault({"gpiochip0", 17}, :busy)           # another program has taken it: handles are closed, who opens it gets {:error, :already_open}
      Lines.clear({"gpiochip0", 17})
      Lines.unplug("gpiochip0", :bumper)              # the device's wires come off
      Lines.replug("gpiochip0", :bumper)              # as after power-on

  ## Wiring something else to a line

  Whoever simulates a chip with an interrupt pin drives the line, with a name of its own. What it says for later comes at that
  time, and carries exactly that time as its stamp:

      Lines.drive({"gpiochip0", 4}, 1, by: {"i2c-1", 0x68}, at_ns: BB.Clock.now_ns(clock) + 1_000_000)

  ## Time

  A chip has a clock, the machine's or a `BB.Clock.Stepped`. With a stepped one all that is due within a step has happened, in its
  order, when `BB.Clock.Stepped.advance/3` returns, and every message of an edge was sent; the processes that get them are to be named
  in its `settle:`. With the machine's, things happen up to a millisecond late and are stamped with the time at which they should have.
  """
  use Supervisor

  require BB.Bus.Sim.GPIO.Line

  alias BB.Bus.Sim.GPIO
  alias BB.Bus.Sim.GPIO.{Line, Server}

  # All chips end with the registry that has their names.
  @restarts [max_restarts: 1_000, max_seconds: 1]

  @typedoc "A chip's name as Linux has it, such as `\"gpiochip0\"`."
  @type name :: String.t()

  @typedoc "A device's model and its options; `:pins` says to which lines its pins are wired: `pins: [trigger: 23, echo: 24]`."
  @type device :: {module(), keyword()}

  @typedoc """
  How a chip is made:

  - `:lines`: how many it has; default 54;
  - `:devices`: `%{name => device}` plugged in from the start;
  - `:clock`: a `t:BB.Clock.t/0`; default `:real`;
  - `:label`: what the chip is called besides its name;
  - `:labels`: `%{line => label}`;
  - `:timestamp_offset_ns`: how far the time stamps of messages are from the clock, as the kernel's are from Erlang's; default 0.
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

  Raises `ArgumentError` when there are no chips. A wrong option of one, or of a device, fails the start. A name that is taken is `{:already_started, pid}` in the supervisor's error.
  """
  @spec start_link(chips: %{name() => chip_options()} | [{name(), chip_options()}]) ::
          Supervisor.on_start()
  def start_link(opts), do: Supervisor.start_link(__MODULE__, chips!(opts))

  @doc "The child specification of a set of chips; its id has their names, so that several sets fit under one supervisor."
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

  @doc "The names of the chips that run now, sorted."
  @spec names() :: [name()]
  def names, do: Server.names()

  @doc """
  A line as it is: the level at the pin (`:near`), at the devices' end (`:far`), its `:fault` (or `nil`) and whether somebody has it `:open?`.
  """
  @spec describe(GPIO.gpio_spec()) ::
          %{near: Line.level(), far: Line.level(), fault: Line.fault() | nil, open?: boolean()}
          | {:error, :not_found}
  def describe(spec), do: ask(spec, &{:describe, &1})

  @doc "The level of a line at the devices' end."
  @spec level(GPIO.gpio_spec()) :: Line.level() | {:error, :not_found}
  def level(spec) do
    with %{far: level} <- describe(spec), do: level
  end

  @doc """
  Drives a line from its far end: `0`, `1`, by a resistor (`:pullup`, `:pulldown`), or no more (`:z`).

  Options: `by:` is who does (default `:hand`), each of whom drives for themselves; `at_ns:` a time of the chip's clock, which is
  the stamp of the edge even where it has passed.
  """
  @spec drive(GPIO.gpio_spec(), Line.drive(), by: term(), at_ns: integer()) ::
          :ok | {:error, :not_found}
  def drive(spec, drive, opts \\ []) when Line.is_drive(drive) do
    opts = Keyword.validate!(opts, by: :hand, at_ns: nil)
    ask(spec, &{:drive, &1, opts[:by], drive, opts[:at_ns]})
  end

  @doc "Lets a line go, and takes back what `by` has said for later."
  @spec release(GPIO.gpio_spec(), by: term()) :: :ok | {:error, :not_found}
  def release(spec, opts \\ []) do
    [by: by] = Keyword.validate!(opts, by: :hand)
    ask(spec, &{:release, &1, by})
  end

  @doc "Breaks a line from now on; a fault before is replaced. Raises `ArgumentError` when `fault` is none."
  @spec fault(GPIO.gpio_spec(), Line.fault()) :: :ok | {:error, :not_found}
  def fault(spec, fault) do
    fault = Line.check_fault!(fault)
    ask(spec, &{:fault, &1, fault})
  end

  @doc "Mends a line."
  @spec clear(GPIO.gpio_spec()) :: :ok | {:error, :not_found}
  def clear(spec), do: ask(spec, &{:fault, &1, nil})

  @doc "What was ever plugged in: for each device its `:module`, its `:pins`, whether it is `:plugged?` and whether its model is `:broken?`."
  @spec devices(name()) :: %{atom() => map()} | {:error, :not_found}
  def devices(chip), do: Server.call(chip, :devices)

  @doc """
  Plugs a new device in, powered up. A name whose device is plugged in is `{:error, :name_taken}`.

  Wrong options of the device raise, here, what its model raises.
  """
  @spec plug(name(), atom(), device()) :: :ok | {:error, :not_found | :name_taken}
  def plug(chip, name, {module, opts} = device) when is_atom(module) and is_list(opts) do
    case Server.call(chip, {:plug, name, device}) do
      {:raise, exception} -> raise exception
      answer -> answer
    end
  end

  @doc "Pulls the device's wires: it drives nothing from now on. Once more changes nothing."
  @spec unplug(name(), atom()) :: :ok | {:error, :not_found | :no_device}
  def unplug(chip, name), do: Server.call(chip, {:unplug, name})

  @doc "Plugs the same device in again, as after power-on. One that is plugged in stays as it is."
  @spec replug(name(), atom()) :: :ok | {:error, :not_found | :no_device}
  def replug(chip, name), do: Server.call(chip, {:replug, name})

  @doc "Does something to a device, such as `:press`; its model says what there is."
  @spec tell(name(), atom(), order :: term()) ::
          :ok | {:error, :not_found | :no_device | :unknown_order}
  def tell(chip, name, order), do: Server.call(chip, {:tell, name, order})

  defp ask(spec, request) do
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
          "expected a chip as {name, options} like {\"gpiochip0\", devices: …}, got: #{inspect(other)}"
  end
end

defmodule BB.Bus.Sim do
  @moduledoc """
  Simulated I2C buses, for a robot without its hardware, and for hardware that breaks on demand.

  Use it in tests and demonstrations. It starts buses, plugs devices in and out, and makes them
  fail. Drivers call a simulated bus through `BB.Bus.Sim.I2C`, which has the functions, results
  and error atoms of `Circuits.I2C`.

      iex> devices = %{0x68 => {BB.Bus.Sim.Mpu6050, source: :motion}}
      iex> {:ok, _pid} = BB.Bus.Sim.start_link(buses: %{"i2c-7" => [devices: devices]})
      iex> {:ok, bus} = BB.Bus.Sim.I2C.open("i2c-7")
      iex> BB.Bus.Sim.I2C.write_read(bus, 0x68, <<0x75>>, 1)
      {:ok, <<0x68>>}
      iex> BB.Bus.Sim.unplug("i2c-7", 0x68)
      iex> BB.Bus.Sim.I2C.write_read(bus, 0x68, <<0x75>>, 1)
      {:error, :i2c_nak}

  A robot that declares the devices of its buses (`simulation do … end`, `BB.Dsl.Robot`)
  needs no `start_link/1`. With `config :ganglion, simulated_buses: %{…}` the application starts
  buses.

  ## Breaking things

      # Every transfer with the device is {:error, :i2c_nak}.
      BB.Bus.Sim.unplug("i2c-1", 0x68)
      # It is back, as after power-on: its registers are lost.
      BB.Bus.Sim.replug("i2c-1", 0x68)

      # Until cleared.
      BB.Bus.Sim.fault("i2c-1", 0x68, :nak)
      # For the next two attempts.
      BB.Bus.Sim.fault("i2c-1", 0x68, {:nak, 2})
      # Holds the bus for the handle's whole timeout, each time.
      BB.Bus.Sim.fault("i2c-1", 0x68, :timeout)
      # Stretches the clock for 5 ms, each time.
      BB.Bus.Sim.fault("i2c-1", 0x68, {:slow, 5})
      # Flips one bit of one byte in a hundred.
      BB.Bus.Sim.fault("i2c-1", 0x68, {:bit_errors, 0.01})
      # A second device answers at the address.
      BB.Bus.Sim.fault("i2c-1", 0x68, {:twin, {BB.Bus.Sim.Mpu6050, source: :motion}})
      BB.Bus.Sim.clear("i2c-1", 0x68)

      # A wire of the bus is held low: every transfer times out, at any address.
      BB.Bus.Sim.stuck("i2c-1")
      BB.Bus.Sim.release("i2c-1")

  These functions return `:ok`, `{:error, :bus_not_found}` or, where they take an address,
  `{:error, :no_device}` for an address that never had a device. They return at once, also while a
  transfer holds the bus.

  ## What is real and what is not

  - Each bus is one process, and runs one transfer at a time, as wires do. A device that holds the
    bus delays the others.
  - A transfer takes no time unless the bus has a `:clock_hz`; then it takes 9 bit times for each
    byte. Times under a millisecond are added up, so that a bus has the right speed on the whole,
    while the end of one transfer is exact to a millisecond.
  - A timeout, a slow device and `:clock_hz` take the machine's time, also where the devices have
    a stepped clock.
  - A timeout takes the time of the handle's option, in steps of 10 ms, as Linux counts it. On
    Linux the last handle that is opened sets the timeout of the adapter for all. Here each handle
    has its own.
  - A VM has one namespace of bus names. Tests that run at once use different names.
  - A device's model that raises is a broken chip: the error is logged, and the device does not
    answer until it is plugged in again. The other devices work. A model that never returns stops
    its bus.
  """
  use Supervisor

  alias BB.Bus.Sim.{Fault, Server}

  # All buses end together with the registry that has their names.
  @restarts [max_restarts: 1_000, max_seconds: 1]

  @typedoc "The name of a bus, as on Linux: `\"i2c-1\"`."
  @type name :: String.t()

  @typedoc "A 7-bit address."
  @type address :: 0..127

  @typedoc "A device's model, and the options for its `c:BB.Bus.Sim.Device.init/2`."
  @type device :: {module(), keyword()}

  @typedoc """
  The options of a bus:

  - `:devices`: the devices that are plugged in from the start, `%{address => device}`; default
    none;
  - `:clock_hz`: the speed of the bus (100_000, 400_000); default `nil`, transfers take no time;
  - `:clock`: the time of the devices: a `t:BB.Clock.t/0`, such as `BB.Clock.of(robot)`, or a
    function that returns nanoseconds, with which no interrupt pin pulses; default `:real`.
  """
  @type bus_options :: [
          devices: %{address() => device()} | [{address(), device()}],
          clock_hz: pos_integer() | nil,
          clock: BB.Clock.t() | (() -> integer())
        ]

  @typedoc """
  A fault of a device.

  The device fails: it does not answer (`:nak`, or `:enxio` as with some adapters), holds the bus
  until the timeout (`:timeout`), loses the bus to another master (`:retry`), or causes an error
  number of the kernel. Or it answers wrongly: `{:slow, ms}`, `{:bit_errors, probability}` or
  `{:twin, device}`, see `t:BB.Bus.Sim.Fault.weakness/0`. `{kind, n}` lasts for `n` attempts,
  another fault until `clear/2`.
  """
  @type fault :: Fault.t()

  @doc """
  Starts buses, linked to the caller: `buses: %{name => bus_options}`.

  A wrong option of a bus or of a device fails the start. A bus name that is taken is
  `{:already_started, pid}` in the supervisor's error.
  """
  @spec start_link(buses: %{name() => bus_options()} | [{name(), bus_options()}]) ::
          Supervisor.on_start()
  def start_link(opts), do: Supervisor.start_link(__MODULE__, opts)

  @doc """
  Returns the child specification of a set of buses.

  Its id has their names, so that one supervisor can have several sets.
  """
  @spec child_spec(keyword()) :: Supervisor.child_spec()
  def child_spec(opts) do
    %{
      id: {__MODULE__, Enum.map(buses(opts), &elem(&1, 0))},
      start: {__MODULE__, :start_link, [opts]},
      type: :supervisor
    }
  end

  @impl Supervisor
  def init(opts) do
    opts
    |> buses()
    |> Enum.map(fn {name, bus} -> Supervisor.child_spec({Server, {name, bus}}, id: name) end)
    |> Supervisor.init([strategy: :one_for_one] ++ @restarts)
  end

  @doc "Returns the names of the simulated buses that run, sorted."
  @spec names() :: [name()]
  def names, do: Server.names()

  @doc """
  Returns the devices of a bus, by address.

  Each has its `:module`, whether it is `:plugged?`, its `:fault` (or `nil`), whether its model is
  `:broken?`, and the number of `:transfers` that it answered. Unplugged devices are included.
  """
  @spec devices(name()) ::
          %{
            address() => %{
              module: module(),
              plugged?: boolean(),
              fault: fault() | nil,
              broken?: boolean(),
              transfers: non_neg_integer()
            }
          }
          | {:error, :bus_not_found}
  def devices(bus), do: Server.call(bus, :devices)

  @doc """
  Plugs a new device in, powered up.

  An address with a device that is plugged in returns `{:error, :address_taken}`. Wrong options of
  the device raise the exception of its model.
  """
  @spec plug(name(), address(), device()) ::
          :ok | {:error, :bus_not_found | :address_taken | term()}
  def plug(bus, address, {module, opts} = device)
      when address in 0..127 and is_atom(module) and is_list(opts),
      do: order(bus, {:plug, address, device})

  @doc "Unplugs a device: nothing answers at its address. Unplugging it again has no effect."
  @spec unplug(name(), address()) :: :ok | {:error, :bus_not_found | :no_device}
  def unplug(bus, address), do: order(bus, {:unplug, address})

  @doc """
  Plugs the same device in again, with the registers of power-on and without a fault.

  A device that is plugged in stays as it is.
  """
  @spec replug(name(), address()) :: :ok | {:error, :bus_not_found | :no_device | term()}
  def replug(bus, address), do: order(bus, {:replug, address})

  @doc """
  Sets the fault of a device, in the place of an earlier one.

  Each attempt of a transfer with retries counts. Raises `ArgumentError` for a term that is no
  fault, and the exception of the model of a twin.
  """
  @spec fault(name(), address(), fault()) :: :ok | {:error, :bus_not_found | :no_device | term()}
  def fault(bus, address, fault), do: order(bus, {:fault, address, Fault.check!(fault)})

  @doc "Clears the device's fault, and keeps its registers."
  @spec clear(name(), address()) :: :ok | {:error, :bus_not_found | :no_device}
  def clear(bus, address), do: order(bus, {:clear, address})

  @doc """
  Holds a wire of the bus low.

  From now on each transfer, at any address, takes its handle's timeout and returns
  `{:error, :timeout}`.
  """
  @spec stuck(name()) :: :ok | {:error, :bus_not_found}
  def stuck(bus), do: order(bus, {:stuck, true})

  @doc "Releases the wire. A transfer that has begun still times out."
  @spec release(name()) :: :ok | {:error, :bus_not_found}
  def release(bus), do: order(bus, {:stuck, false})

  defp order(bus, order) do
    case Server.call(bus, order) do
      {:raise, exception} -> raise exception
      answer -> answer
    end
  end

  defp buses(opts) do
    case Keyword.fetch(opts, :buses) do
      {:ok, buses} when is_map(buses) or is_list(buses) ->
        Enum.map(buses, &bus!/1)

      _ ->
        raise ArgumentError, "expected buses: %{name => options}, got: #{inspect(opts)}"
    end
  end

  defp bus!({name, opts}) when is_binary(name) and is_list(opts), do: {name, opts}

  defp bus!(other) do
    raise ArgumentError,
          "expected a bus, such as {\"i2c-1\", devices: …}, got: #{inspect(other)}"
  end
end

defmodule BB.Bus.Sim do
  @moduledoc """
  Simulated I2C buses: a robot without its hardware, and hardware that breaks on demand.

      iex> devices = %{0x68 => {BB.Bus.Sim.Mpu6050, source: :motion}}
      iex> {:ok, _pid} = BB.Bus.Sim.start_link(buses: %{"i2c-7" => [devices: devices]})
      iex> {:ok, bus} = BB.Bus.Sim.I2C.open("i2c-7")
      iex> BB.Bus.Sim.I2C.write_read(bus, 0x68, <<0x75>>, 1)
      {:ok, <<0x68>>}
      iex> BB.Bus.Sim.unplug("i2c-7", 0x68)
      iex> BB.Bus.Sim.I2C.write_read(bus, 0x68, <<0x75>>, 1)
      {:error, :i2c_nak}

  Drivers talk to a simulated bus by `BB.Bus.Sim.I2C`, which has the functions, results and error atoms of
  `Circuits.I2C`; they cannot tell the difference. This module is the other side, the hand that holds the wires: it plugs
  and unplugs devices and makes them fail.

  A robot that declares what hangs on its buses (`simulation do … end`, `BB.Dsl.Simulation`) needs no
  `start_link/1`; `config :ganglion, simulated_buses: %{…}` has the application start some.

  ## Breaking things

      BB.Bus.Sim.unplug("i2c-1", 0x68)                      # every transfer to it: {:error, :i2c_nak}
      BB.Bus.Sim.replug("i2c-1", 0x68)                      # back, as after power-on: its registers are lost
      BB.Bus.Sim.fault("i2c-1", 0x68, :nak)                 # until cleared
      BB.Bus.Sim.fault("i2c-1", 0x68, {:nak, 2})            # the next two attempts, then well again
      BB.Bus.Sim.fault("i2c-1", 0x68, :timeout)             # holds the bus for the handle's whole timeout, each time
      BB.Bus.Sim.fault("i2c-1", 0x68, {:slow, 5})           # stretches the clock for 5 ms, each time
      BB.Bus.Sim.fault("i2c-1", 0x68, {:bit_errors, 0.01})  # one bit of one byte in a hundred is wrong
      BB.Bus.Sim.fault("i2c-1", 0x68, {:twin, {BB.Bus.Sim.Mpu6050, source: :motion}})  # a second device at the address
      BB.Bus.Sim.clear("i2c-1", 0x68)
      BB.Bus.Sim.stuck("i2c-1")                             # a wire of the bus is held low: every transfer, to whom it may be, times out
      BB.Bus.Sim.release("i2c-1")

  All of them answer `:ok`, `{:error, :bus_not_found}` or, where they name an address, `{:error, :no_device}` (nothing was ever
  plugged in there), at once, also while a transfer holds the bus.

  ## What is real and what is not

  - Each bus is one process, and transfers on it follow one another as on wires: a device that holds the bus delays the others.
  - A transfer takes no time unless the bus has a `:clock_hz`; then it takes 9 bit times a byte. Costs under a millisecond are
    saved up, so that a bus is as slow as it should be on the whole, while one transfer's end is exact to a millisecond only.
  - What holds the bus (a timeout, a slow device, `:clock_hz`) takes the machine's time, also where the devices' time is stepped.
  - A timeout takes the time that the handle was opened with, in steps of 10 ms as Linux counts it. On Linux the last one who
    opened the adapter sets the timeout for all; here each handle has its own.
  - Bus names are one namespace in a VM: tests that run at once use a name each.
  - A device's model that raises is a broken chip, no more: the error is logged, the device stops answering until it is plugged
    in again, and the others on the bus go on. A model that never returns stops its bus.
  """
  use Supervisor

  alias BB.Bus.Sim.{Fault, Server}

  # All buses end with the registry that has their names.
  @restarts [max_restarts: 1_000, max_seconds: 1]

  @typedoc "A bus name as Linux has it, such as `\"i2c-1\"`."
  @type name :: String.t()

  @typedoc "A 7-bit address."
  @type address :: 0..127

  @typedoc "A device's model and the options of its `c:BB.Bus.Sim.Device.init/2`."
  @type device :: {module(), keyword()}

  @typedoc """
  How a bus is made:

  - `:devices`: `%{address => device}` plugged in from the start; default none;
  - `:clock_hz`: the bus's clock (100_000, 400_000); default `nil`, transfers are instant;
  - `:clock`: the devices' time: a `t:BB.Clock.t/0`, such as `BB.Clock.of(robot)`, or a function that returns nanoseconds, with which
    no interrupt pin pulses; default `:real`.
  """
  @type bus_options :: [
          devices: %{address() => device()} | [{address(), device()}],
          clock_hz: pos_integer() | nil,
          clock: BB.Clock.t() | (() -> integer())
        ]

  @typedoc """
  What a faulty device does.

  It fails: does not answer (`:nak`; `:enxio` where an adapter calls it so), holds the bus until the timeout (`:timeout`), loses the
  bus to another master (`:retry`), or gives an error number of the kernel. Or it answers badly: `{:slow, ms}`, `{:bit_errors,
  probability}`, `{:twin, device}`, see `t:BB.Bus.Sim.Fault.weakness/0`. `{kind, n}` lasts for `n` attempts, else until `clear/2`.
  """
  @type fault :: Fault.t()

  @doc """
  Starts buses, linked to the caller: `buses: %{name => bus_options}`.

  A wrong option, or one of a device, fails the start. A bus name that is taken is `{:already_started, pid}` in the supervisor's error.
  """
  @spec start_link(buses: %{name() => bus_options()} | [{name(), bus_options()}]) ::
          Supervisor.on_start()
  def start_link(opts), do: Supervisor.start_link(__MODULE__, opts)

  @doc "The child specification of a set of buses; its id has their names, so that several sets fit under one supervisor."
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

  @doc "The names of the simulated buses that run now, sorted."
  @spec names() :: [name()]
  def names, do: Server.names()

  @doc """
  What is on the bus: for each address ever plugged in its `:module`, whether it is `:plugged?`, its `:fault` (or `nil`), whether its
  model is `:broken?`, and the number of `:transfers` that it answered.
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
  Plugs a new device in, powered up. An address that answers is `{:error, :address_taken}`; one whose device was unplugged is free.

  Wrong options of the device raise, here, what its model raises.
  """
  @spec plug(name(), address(), device()) ::
          :ok | {:error, :bus_not_found | :address_taken | term()}
  def plug(bus, address, {module, opts} = device)
      when address in 0..127 and is_atom(module) and is_list(opts),
      do: order(bus, {:plug, address, device})

  @doc "Pulls the device's wires: nothing answers at its address from now on. Once more changes nothing."
  @spec unplug(name(), address()) :: :ok | {:error, :bus_not_found | :no_device}
  def unplug(bus, address), do: order(bus, {:unplug, address})

  @doc "Plugs the same device in again: powered up with the registers of power-on, without fault. One that is plugged in stays as it is."
  @spec replug(name(), address()) :: :ok | {:error, :bus_not_found | :no_device | term()}
  def replug(bus, address), do: order(bus, {:replug, address})

  @doc """
  Makes the device fail from now on; a fault before is replaced. Each attempt of a transfer with retries counts.

  Raises `ArgumentError` when `fault` is none, and what the model of a twin raises.
  """
  @spec fault(name(), address(), fault()) :: :ok | {:error, :bus_not_found | :no_device | term()}
  def fault(bus, address, fault), do: order(bus, {:fault, address, Fault.check!(fault)})

  @doc "Ends the device's fault. Its registers are as they were."
  @spec clear(name(), address()) :: :ok | {:error, :bus_not_found | :no_device}
  def clear(bus, address), do: order(bus, {:clear, address})

  @doc "Holds a wire of the bus low: from now on each transfer, at whatever address, takes its handle's timeout and is `{:error, :timeout}`."
  @spec stuck(name()) :: :ok | {:error, :bus_not_found}
  def stuck(bus), do: order(bus, {:stuck, true})

  @doc "Lets go of the wire: the bus is as before, its devices too. A transfer that has begun still times out."
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

  defp bus!(other),
    do:
      raise(
        ArgumentError,
        "expected a bus as {name, options} like {\"i2c-1\", devices: …}, got: #{inspect(other)}"
      )
end

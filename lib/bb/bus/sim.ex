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

  ## Breaking things

      BB.Bus.Sim.unplug("i2c-1", 0x68)            # every transfer to it: {:error, :i2c_nak}
      BB.Bus.Sim.replug("i2c-1", 0x68)            # back, as after power-on: its registers are lost
      BB.Bus.Sim.fault("i2c-1", 0x68, :nak)       # until cleared
      BB.Bus.Sim.fault("i2c-1", 0x68, {:nak, 2})  # the next two attempts, then well again
      BB.Bus.Sim.fault("i2c-1", 0x68, :timeout)   # holds the bus for the handle's whole timeout, each time
      BB.Bus.Sim.clear("i2c-1", 0x68)

  All of them answer `:ok`, `{:error, :bus_not_found}` or `{:error, :no_device}` (nothing was ever plugged in there), at
  once, also while a transfer holds the bus.

  ## What is real and what is not

  - Each bus is one process, and transfers on it follow one another as on wires: a device that holds the bus delays the others.
  - A transfer takes no time unless the bus has a `:clock_hz`; then it takes 9 bit times a byte. Costs under a millisecond are
    saved up, so that a bus is as slow as it should be on the whole, while one transfer's end is exact to a millisecond only.
  - A timeout takes the time that the handle was opened with, in steps of 10 ms as Linux counts it. On Linux the last one who
    opened the adapter sets the timeout for all; here each handle has its own.
  - Bus names are one namespace in a VM: tests that run at once use a name each.
  - A device's model that raises is a broken chip, no more: the error is logged, the device stops answering until it is plugged
    in again, and the others on the bus go on. A model that never returns stops its bus.
  """
  use Supervisor

  alias BB.Bus.Sim.{Fault, Server}

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
  - `:clock`: a function that returns the devices' time in nanoseconds; default the monotonic clock. A test that steps time gives its own.
  """
  @type bus_options :: [
          devices: %{address() => device()} | [{address(), device()}],
          clock_hz: pos_integer() | nil,
          clock: (() -> integer())
        ]

  @typedoc """
  What a faulty device does: not answer (`:nak`; `:enxio` where an adapter calls it so), hold the bus until the timeout (`:timeout`), lose the bus to another
  master (`:retry`), or fail with an error number of the kernel. `{kind, n}` lasts for `n` attempts, else until `clear/2`.
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
    |> Supervisor.init(strategy: :one_for_one)
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
      when address in 0..127 and is_atom(module) and is_list(opts) do
    case Server.call(bus, {:plug, address, device}) do
      {:raise, exception} -> raise exception
      answer -> answer
    end
  end

  @doc "Pulls the device's wires: nothing answers at its address from now on. Once more changes nothing."
  @spec unplug(name(), address()) :: :ok | {:error, :bus_not_found | :no_device}
  def unplug(bus, address), do: Server.call(bus, {:unplug, address})

  @doc "Plugs the same device in again: powered up with the registers of power-on, without fault. One that is plugged in stays as it is."
  @spec replug(name(), address()) :: :ok | {:error, :bus_not_found | :no_device | term()}
  def replug(bus, address), do: Server.call(bus, {:replug, address})

  @doc """
  Makes the device fail from now on; a fault before is replaced. Each attempt of a transfer with retries counts.

  Raises `ArgumentError` when `fault` is none.
  """
  @spec fault(name(), address(), fault()) :: :ok | {:error, :bus_not_found | :no_device}
  def fault(bus, address, fault), do: Server.call(bus, {:fault, address, Fault.check!(fault)})

  @doc "Ends the device's fault. Its registers are as they were."
  @spec clear(name(), address()) :: :ok | {:error, :bus_not_found | :no_device}
  def clear(bus, address), do: Server.call(bus, {:fault, address, nil})

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

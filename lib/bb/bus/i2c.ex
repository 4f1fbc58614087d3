defmodule BB.Bus.I2C do
  @moduledoc """
  I2C buses shared by several sensors, with the functions, results and errors of `Circuits.I2C` 2.

  Drivers use it in the place of `Circuits.I2C`. `BB.Bus.I2C.Device` builds on it for chips with
  registers.

      i2c = BB.Bus.I2C.module(opts[:i2c])
      {:ok, bus} = i2c.open("i2c-1", timeout: 20)
      {:ok, <<0x68>>} = i2c.write_read(bus, 0x68, <<0x75>>, 1)

  The backend is the module that talks to the wires: `Circuits.I2C` where that library is loaded,
  as on a board, otherwise the simulation, `BB.Bus.Sim.I2C`. `config :ganglion, i2c: …` names
  another one.

  Each bus has one process, which makes all transfers. It starts with the first `open/2` and ends
  when the last handle is closed. A handle is also closed when the process that opened it ends.

  ## Sharing

  - Transfers run in the order of the calls, one at a time. A sensor waits for at most one
    transfer of each other sensor.
  - The backend is opened once, with the smallest timeout of all handles, between 20 and 50 ms. So
    no transfer holds the bus or a scheduler thread for longer.
  - A stuck bus (`BB.Bus.I2C.Recovery` defines it) is closed and reopened once for all its
    sensors, after 10 ms, and from then on up to every 100 ms until a device answers. While it is
    down, calls fail at once.
  - A device that always times out delays the others by its timeout. The bus stays open.

  After the application has ended, buses can still be opened and used, without sharing. A
  `disarm/1` that runs at that moment still makes the hardware safe.

  ## Errors

  Errors are those of the backend. For `Circuits.I2C` they are

  | term | cause |
  |---|---|
  | `{:error, :bus_not_found}` | `open/2`: no bus of this name |
  | `{:error, :i2c_nak}`, `{:error, :enxio}` | no device answers at the address, or the device refuses |
  | `{:error, :timeout}` | the bus was held for the whole timeout |
  | `{:error, :retry}` | the bus was lost to another master |
  | `{:error, :not_supported}` | the adapter does not support the transfer |
  | `{:error, {:errno, n}}` | another error of the kernel |

  While a bus is down, each call returns at once the error that closed the bus: `:timeout`, or
  `{:errno, 19}` and then `:bus_not_found` where the adapter is gone. A closed handle returns
  `{:error, {:errno, 9}}`. Wrong arguments raise in the caller, as they do in the backend.

  ## When not to use it

  A device that holds the bus for longer than 50 ms by design needs a handle of its own: give its
  driver the backend's module.
  """
  alias BB.Bus.I2C.{Client, Scan}
  alias BB.Bus.I2C.Supervisor, as: Buses

  @enforce_keys [:name, :backend, :timeout_ms, :pid, :ref, :retries]
  defstruct [:name, :backend, :timeout_ms, :pid, :ref, :retries]

  @typedoc """
  An open bus.

  Any process may use it. It is closed when the process that opened it ends.
  """
  @type t :: %__MODULE__{
          name: String.t(),
          backend: module(),
          timeout_ms: pos_integer(),
          pid: pid(),
          ref: reference(),
          retries: non_neg_integer()
        }

  @typedoc "A 7-bit device address."
  @type address :: 0..127

  @timeouts_ms 20..50

  # Each attempt is a transfer of its own, so that those of other handles run in between.
  @one_attempt [retries: 0]

  @doc """
  Returns the module that a driver calls: the one `given` in its options, otherwise this module.

  A module that is given is called directly, without sharing.

      iex> BB.Bus.I2C.module(nil)
      BB.Bus.I2C
      iex> BB.Bus.I2C.module(BB.Bus.Sim.I2C)
      BB.Bus.Sim.I2C
  """
  @spec module(module() | nil) :: module()
  def module(nil), do: __MODULE__
  def module(given) when is_atom(given), do: given

  @doc """
  Returns the module that talks to the wires: the one of `config :ganglion, :i2c`, otherwise
  `Circuits.I2C` where it can be loaded, otherwise `BB.Bus.Sim.I2C`.
  """
  @spec backend() :: module()
  def backend, do: Application.get_env(:ganglion, :i2c) || default()

  defp default, do: if(Code.ensure_loaded?(Circuits.I2C), do: Circuits.I2C, else: BB.Bus.Sim.I2C)

  @doc """
  Opens a bus.

  A stuck bus can be opened too.

  ## Options

  - `:timeout`: how long a device may hold the bus, in milliseconds; it is limited to 20..50. A
    negative value, as by default, means 50. The bus has the smallest timeout of all its handles;
  - `:retries`: how often a failed transfer of this handle is tried again, each time behind the
    transfers that wait; default 0;
  - `:backend`: a module in the place of `backend/0`;
  - `:clock`: the `t:BB.Clock.t/0` that measures the delays of a bus that is down; default
    `:real`. The clock of the first handle counts.

  Other options are ignored.
  """
  @spec open(String.t(), keyword()) :: {:ok, t()} | {:error, term()}
  def open(bus_name, opts \\ []) when is_binary(bus_name) do
    backend = Keyword.get_lazy(opts, :backend, &backend/0)
    timeout_ms = opts |> Keyword.get(:timeout, -1) |> timeout_ms!()
    retries = retries!(opts, 0)
    clock = Keyword.get(opts, :clock, :real)

    with {:ok, pid, ref} <- Client.open({backend, bus_name}, timeout_ms, clock) do
      {:ok,
       %__MODULE__{
         name: bus_name,
         backend: backend,
         timeout_ms: timeout_ms,
         pid: pid,
         ref: ref,
         retries: retries
       }}
    end
  end

  @doc "Reads `count` bytes from the device. The option `:retries` overrides the one of `open/2`."
  @spec read(t(), address(), non_neg_integer(), keyword()) :: {:ok, binary()} | {:error, term()}
  def read(%__MODULE__{} = bus, address, count, opts \\ []),
    do: transfer(bus, :read, [address, count, @one_attempt], retries!(opts, bus.retries))

  @doc "Writes bytes to the device."
  @spec write(t(), address(), iodata(), keyword()) :: :ok | {:error, term()}
  def write(%__MODULE__{} = bus, address, data, opts \\ []),
    do: transfer(bus, :write, [address, data, @one_attempt], retries!(opts, bus.retries))

  @doc "Writes bytes and then reads `count` bytes, in one transfer."
  @spec write_read(t(), address(), iodata(), non_neg_integer(), keyword()) ::
          {:ok, binary()} | {:error, term()}
  def write_read(%__MODULE__{} = bus, address, data, count, opts \\ []),
    do:
      transfer(
        bus,
        :write_read,
        [address, data, count, @one_attempt],
        retries!(opts, bus.retries)
      )

  @doc "Closes the handle, and leaves the others open. Closing it again has no effect."
  @spec close(t()) :: :ok
  def close(%__MODULE__{} = bus), do: Client.close(bus)

  @doc "Returns the names of the backend's buses."
  @spec bus_names() :: [String.t()]
  def bus_names, do: backend().bus_names()

  @doc """
  Returns the addresses from 0x03 to 0x77 at which a device answers.

  The scan can disturb some devices.
  """
  @spec detect_devices(t() | String.t()) :: [address()] | {:error, term()}
  def detect_devices(bus) when is_binary(bus) or is_struct(bus, __MODULE__),
    do: Scan.detect_devices(__MODULE__, bus)

  @doc "Returns whether a device answers at the address, as the backend finds it out."
  @spec device_present?(t(), address()) :: boolean()
  def device_present?(%__MODULE__{} = bus, address),
    do: Client.transfer(bus, :device_present?, [address]) == true

  @doc """
  Returns the states of the open buses, sorted by name.

  Each has

  - `:bus`, its name, and `:backend`;
  - `:state`: `:up`, `:down` (closed for a moment; calls fail at once) or `:trying` (reopened, and
    no device has answered yet);
  - `:error`: the error that closed it, `nil` while it is up;
  - `:reopened`: how often it was reopened since its process started;
  - `:handles`: how many handles are open.
  """
  @spec health() :: [
          %{
            bus: String.t(),
            backend: module(),
            state: :up | :down | :trying,
            error: term(),
            reopened: non_neg_integer(),
            handles: non_neg_integer()
          }
        ]
  def health do
    Buses.registry()
    |> Registry.select([{{:_, :_, :"$1"}, [{:is_map, :"$1"}], [:"$1"]}])
    |> Enum.sort_by(& &1.bus)
  end

  defp transfer(bus, function, arguments, retries) do
    with {:error, _error} when retries > 0 <- Client.transfer(bus, function, arguments),
         do: transfer(bus, function, arguments, retries - 1)
  end

  defp timeout_ms!(timeout) when is_integer(timeout) and timeout < 0, do: @timeouts_ms.last

  defp timeout_ms!(timeout) when is_integer(timeout),
    do: timeout |> max(@timeouts_ms.first) |> min(@timeouts_ms.last)

  defp timeout_ms!(other) do
    raise ArgumentError,
          "expected timeout: an integer in milliseconds, got: #{inspect(other)}"
  end

  defp retries!(opts, default) do
    case Keyword.get(opts, :retries, default) do
      retries when is_integer(retries) and retries >= 0 ->
        retries

      other ->
        raise ArgumentError, "expected retries: an integer from 0 on, got: #{inspect(other)}"
    end
  end
end

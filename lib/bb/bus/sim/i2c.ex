defmodule BB.Bus.Sim.I2C do
  @moduledoc """
  Simulated I2C with the interface of `Circuits.I2C` 2: the same names, arities, results and error
  atoms.

  It is the backend of `BB.Bus.I2C` where `Circuits.I2C` is not loaded, as in tests and on a
  laptop. `BB.Bus.Sim` starts the buses, and breaks them.

      {:ok, bus} = BB.Bus.Sim.I2C.open("i2c-1", timeout: 20)
      {:ok, <<0x68>>} = BB.Bus.Sim.I2C.write_read(bus, 0x68, <<0x75>>, 1)

  ## Errors

  | term | cause |
  |---|---|
  | `{:error, :bus_not_found}` | `open/2`: no bus of this name runs |
  | `{:error, :i2c_nak}` | no device answers at the address, or the device refuses |
  | `{:error, :enxio}` | the same, with some adapters; here only as a fault |
  | `{:error, :timeout}` | the device held the bus for the handle's timeout |
  | `{:error, :retry}` | the bus was lost to another master |
  | `{:error, {:errno, 9}}` | the handle is closed |
  | `{:error, {:errno, 19}}` | the bus was stopped since it was opened |
  | `{:error, {:errno, 22}}` | more than 8192 bytes at once |
  | `{:error, {:errno, n}}` | a fault with this number |

  A wrong argument (an address that is no integer, data that is no iodata, a negative count)
  raises `ArgumentError`.
  """
  import BB.Bus.I2C.Scan, only: [is_memory_chip: 1]

  alias BB.Bus.I2C.Scan
  alias BB.Bus.Sim.Server

  @enforce_keys [:name, :pid, :closed, :retries, :timeout_ms]
  defstruct [:name, :pid, :closed, :retries, :timeout_ms, flags: [:supports_empty_write]]

  @typedoc """
  An open bus.

  It belongs to no process. Processes may share it. Closing it closes it for all.
  """
  @type t :: %__MODULE__{}

  @typedoc "A 7-bit device address."
  @type address :: 0..127

  @default_timeout_ms 1000
  @longest 8192
  @bad_file_descriptor 9
  @invalid_argument 22

  @doc """
  Opens a bus.

  ## Options

  - `:timeout`: how long a device may hold the bus, in milliseconds, in steps of 10 as on Linux
    and at least 10. A negative value, as by default, means 1000;
  - `:retries`: how often a failed transfer is tried again; default 0.

  Other options are ignored.
  """
  @spec open(String.t(), keyword()) :: {:ok, t()} | {:error, :bus_not_found}
  def open(name, opts \\ []) when is_binary(name) do
    retries = retries!(Keyword.get(opts, :retries, 0))
    timeout_ms = timeout_ms!(Keyword.get(opts, :timeout, -1))

    case Server.fetch(name) do
      {:ok, pid} -> {:ok, handle(name, pid, retries, timeout_ms)}
      :error -> {:error, :bus_not_found}
    end
  end

  @doc "Reads `count` bytes from the device. The option `:retries` overrides the one of `open/2`."
  @spec read(t(), address(), non_neg_integer(), keyword()) :: {:ok, binary()} | {:error, term()}
  def read(%__MODULE__{} = bus, address, count, opts \\ []),
    do: transfer(bus, address, {nil, count!(count)}, opts)

  @doc "Writes bytes to the device. An empty write checks only whether a device answers."
  @spec write(t(), address(), iodata(), keyword()) :: :ok | {:error, term()}
  def write(%__MODULE__{} = bus, address, data, opts \\ []),
    do: transfer(bus, address, {IO.iodata_to_binary(data), nil}, opts)

  @doc "Writes bytes and then reads `count` bytes, in one transfer."
  @spec write_read(t(), address(), iodata(), non_neg_integer(), keyword()) ::
          {:ok, binary()} | {:error, term()}
  def write_read(%__MODULE__{} = bus, address, data, count, opts \\ []),
    do: transfer(bus, address, {IO.iodata_to_binary(data), count!(count)}, opts)

  @doc "Closes the handle. Closing it again has no effect."
  @spec close(t()) :: :ok
  def close(%__MODULE__{closed: closed}), do: :atomics.put(closed, 1, 1)

  @doc "Returns the names of the buses that run, sorted."
  @spec bus_names() :: [String.t()]
  def bus_names, do: Server.names()

  @doc """
  Returns the addresses from 0x03 to 0x77 at which a device answers.

  The scan can disturb some devices, as on real wires.
  """
  @spec detect_devices(t() | String.t()) :: [address()] | {:error, term()}
  def detect_devices(bus) when is_binary(bus) or is_struct(bus, __MODULE__),
    do: Scan.detect_devices(__MODULE__, bus)

  @doc """
  Returns whether a device answers at the address: to an empty write, or to a read at an address
  of memory chips, in which an empty write could change a byte.
  """
  @spec device_present?(t(), address()) :: boolean()
  def device_present?(bus, address) when is_memory_chip(address),
    do: match?({:ok, _}, read(bus, address, 1))

  def device_present?(bus, address), do: write(bus, address, <<>>) == :ok

  defp handle(name, pid, retries, timeout_ms) do
    %__MODULE__{
      name: name,
      pid: pid,
      closed: :atomics.new(1, []),
      retries: retries,
      timeout_ms: timeout_ms
    }
  end

  defp transfer(bus, address, request, opts) do
    transfer = %{
      address: address!(address),
      request: request,
      retries: retries!(Keyword.get(opts, :retries, bus.retries)),
      timeout_ms: bus.timeout_ms
    }

    cond do
      :atomics.get(bus.closed, 1) == 1 -> {:error, {:errno, @bad_file_descriptor}}
      too_long?(request) -> {:error, {:errno, @invalid_argument}}
      true -> Server.transfer(bus.pid, transfer)
    end
  end

  defp too_long?({data, count}), do: byte_size(data || <<>>) > @longest or (count || 0) > @longest

  defp timeout_ms!(timeout) when is_integer(timeout) and timeout < 0, do: @default_timeout_ms
  defp timeout_ms!(timeout) when is_integer(timeout), do: max(div(timeout + 5, 10), 1) * 10

  defp timeout_ms!(other) do
    raise ArgumentError,
          "expected timeout: an integer in milliseconds, got: #{inspect(other)}"
  end

  defp retries!(retries) when is_integer(retries) and retries >= 0, do: retries

  defp retries!(other),
    do: raise(ArgumentError, "expected retries: an integer from 0 on, got: #{inspect(other)}")

  defp address!(address) when is_integer(address) and address >= 0, do: address

  defp address!(other),
    do: raise(ArgumentError, "expected an address: an integer from 0 on, got: #{inspect(other)}")

  defp count!(count) when is_integer(count) and count >= 0, do: count

  defp count!(other),
    do: raise(ArgumentError, "expected the number of bytes to read, got: #{inspect(other)}")
end

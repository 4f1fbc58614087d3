defmodule BB.Bus.Linux.I2C do
  @moduledoc """
  I2C of a Linux machine, with the interface of `Circuits.I2C` 2: the same names, arities, results
  and error atoms.

  Use it on a machine without Nerves, as the backend of `BB.Bus.I2C`, through which drivers share
  a bus. It calls the kernel's i2c-dev (`/dev/i2c-1`).

      {:ok, bus} = BB.Bus.Linux.I2C.open("i2c-1", timeout: 20)
      {:ok, <<0x68>>} = BB.Bus.Linux.I2C.write_read(bus, 0x68, <<0x75>>, 1)

  Transfers run on the dirty I/O schedulers. A bus is closed by `close/1`, or when its handle is
  garbage collected.

  ## Errors

  | term | errno | cause |
  |---|---|---|
  | `{:error, :bus_not_found}` | ENOENT | `open/2`: no file of this name |
  | `{:error, :i2c_nak}` | EREMOTEIO | no device answers at the address, or the device refuses |
  | `{:error, :enxio}` | ENXIO | the same, with other adapters |
  | `{:error, :timeout}` | ETIMEDOUT | the bus was held for the whole timeout |
  | `{:error, :retry}` | EAGAIN | the bus was lost to another master |
  | `{:error, :not_supported}` | EOPNOTSUPP | the adapter supports only SMBus |
  | `{:error, {:errno, 9}}` | EBADF | the handle is closed |
  | `{:error, {:errno, 13}}` | EACCES | `open/2`: no rights; `BB.Bus.Linux.explain/2` names the group that has them |
  | `{:error, {:errno, 19}}` | ENODEV | the adapter was unplugged |
  | `{:error, {:errno, 22}}` | EINVAL | more than 8192 bytes at once |
  | `{:error, {:errno, 25}}` | ENOTTY | `open/2`: the file is no I2C adapter |
  | `{:error, {:errno, n}}` | n | another error |

  ## Compared with Circuits

  | function | here |
  |---|---|
  | `open/1,2`, `close/1`, `bus_names/0` | the same |
  | `read/3,4`, `write/3,4`, `write_read/4,5`, and each with `!` | the same |
  | `detect_devices/0,1`, `device_present?/2` | the same |
  | `discover/1,2`, `discover_one/1,2`, `discover_one!/1,2` | the same |
  | `info/0,1` | the same, for this module |
  | `Circuits.I2C.Bus` and other backends | absent: this module is the interface |

  Where the behaviour of Circuits can do harm, this module differs:

  - An address above 127 raises. Circuits truncates it, and writes to another device.
  - More than 65535 bytes are an error. Circuits reads some of them.
  - A file that is no I2C adapter gets no request, which it could take for a command.
  - Every error of an adapter whose file is gone is `{:errno, 19}`, so that `BB.Bus.I2C` reopens
    the bus. Circuits returns the error of the adapter's driver, and drivers differ.

  The kernel has one timeout for each adapter: the last handle that sets it sets it for all.
  """

  import BB.Bus.I2C.Scan, only: [is_memory_chip: 1]

  alias BB.Bus.I2C.Scan
  alias BB.Bus.Linux
  alias BB.Bus.Linux.{Error, Native}

  @enforce_keys [:ref, :name, :path, :inode, :retries, :flags]
  defstruct [:ref, :name, :path, :inode, :retries, :flags]

  @typedoc """
  An open bus.

  It belongs to no process. Processes may share it. Closing it closes it for all.
  """
  @type t :: %__MODULE__{}

  @typedoc "A 7-bit device address."
  @type address :: 0..127

  @typedoc "Returns whether a device is at an address."
  @type present? :: (t(), address() -> boolean())

  @prefix "i2c-"
  @longest_timeout_ms 0x7FFFFFFF
  @step_ms 10
  # I2C_FUNC_SMBUS_QUICK of linux/i2c.h.
  @quick 0x00010000
  @enodev 19
  @ebadf 9

  @doc """
  Opens a bus.

  ## Options

  - `:timeout`: how long a transfer may take, in milliseconds, in steps of 10 and at least 10. The
    default, below 0, leaves the adapter's timeout;
  - `:retries`: how often a failed transfer is tried again; default 0.

  Other options are ignored.
  """
  @spec open(String.t(), keyword()) :: {:ok, t()} | {:error, term()}
  def open(name, opts \\ []) when is_binary(name) do
    retries = retries!(opts, 0)
    steps = steps!(Keyword.get(opts, :timeout, -1))

    if Linux.name?(name), do: open(name, retries, steps), else: {:error, :bus_not_found}
  end

  defp open(name, retries, steps) do
    path = Linux.path(name)

    case Native.i2c_open(path, steps) do
      {:ok, {ref, functions}} ->
        {:ok,
         %__MODULE__{
           ref: ref,
           name: name,
           path: path,
           inode: inode(path),
           retries: retries,
           flags: flags(functions)
         }}

      {:error, errno} ->
        {:error, Error.i2c(errno)}
    end
  end

  @doc "Reads `count` bytes from the device. The option `:retries` overrides the one of `open/2`."
  @spec read(t(), address(), non_neg_integer(), keyword()) :: {:ok, binary()} | {:error, term()}
  def read(%__MODULE__{} = bus, address, count, opts \\ []) do
    arguments = [bus.ref, address!(address), nil, count!(count)]
    transfer(bus, :i2c_read, arguments, retries!(opts, bus.retries))
  end

  @doc "Reads as `read/4` does, and raises an error."
  @spec read!(t(), address(), non_neg_integer(), keyword()) :: binary()
  def read!(bus, address, count, opts \\ []), do: value!(read(bus, address, count, opts))

  @doc "Writes bytes to the device. An empty write checks only whether a device answers."
  @spec write(t(), address(), iodata(), keyword()) :: :ok | {:error, term()}
  def write(%__MODULE__{} = bus, address, data, opts \\ []) do
    arguments = [bus.ref, address!(address), IO.iodata_to_binary(data)]
    transfer(bus, :i2c_write, arguments, retries!(opts, bus.retries))
  end

  @doc "Writes as `write/4` does, and raises an error."
  @spec write!(t(), address(), iodata(), keyword()) :: :ok
  def write!(bus, address, data, opts \\ []), do: value!(write(bus, address, data, opts))

  @doc "Writes bytes and then reads `count` bytes, in one transfer."
  @spec write_read(t(), address(), iodata(), non_neg_integer(), keyword()) ::
          {:ok, binary()} | {:error, term()}
  def write_read(%__MODULE__{} = bus, address, data, count, opts \\ []) do
    arguments = [bus.ref, address!(address), IO.iodata_to_binary(data), count!(count)]
    transfer(bus, :i2c_read, arguments, retries!(opts, bus.retries))
  end

  @doc "Writes and reads as `write_read/5` does, and raises an error."
  @spec write_read!(t(), address(), iodata(), non_neg_integer(), keyword()) :: binary()
  def write_read!(bus, address, data, count, opts \\ []),
    do: value!(write_read(bus, address, data, count, opts))

  @doc "Closes the handle. Closing it again has no effect."
  @spec close(t()) :: :ok
  def close(%__MODULE__{ref: ref}), do: Native.i2c_close(ref)

  @doc "Returns the names of the machine's buses, in the order of their numbers."
  @spec bus_names() :: [String.t()]
  def bus_names, do: Linux.devices(@prefix)

  @doc "Prints the addresses of each bus at which a device answers, for the console."
  @spec detect_devices() :: :"do not show this result in output"
  def detect_devices do
    for name <- bus_names(), do: IO.puts("#{name}: #{format_found(detect_devices(name))}")

    if bus_names() == [],
      do: IO.puts("no I2C bus: docs/guides/raspberry-pi-os.md shows how to get one")

    :"do not show this result in output"
  end

  @doc """
  Returns the addresses from 0x03 to 0x77 at which a device answers.

  The scan can disturb some devices.
  """
  @spec detect_devices(t() | String.t()) :: [address()] | {:error, term()}
  def detect_devices(bus) when is_binary(bus) or is_struct(bus, __MODULE__),
    do: Scan.detect_devices(__MODULE__, bus)

  @doc """
  Returns the buses and addresses of a device, out of its possible addresses.

  By default a device is present where one answers. `present?` replaces this check.
  """
  @spec discover([address()], present?()) :: [{String.t(), address()}]
  def discover(possible, present? \\ &device_present?/2),
    do: Enum.flat_map(bus_names(), &discover_on(&1, possible, present?))

  @doc "Returns the bus and address of a device that exists once, as `discover/2` finds them."
  @spec discover_one([address()], present?()) ::
          {:ok, {String.t(), address()}} | {:error, :not_found | :multiple_possible_matches}
  def discover_one(possible, present? \\ &device_present?/2) do
    case discover(possible, present?) do
      [found] -> {:ok, found}
      [] -> {:error, :not_found}
      _several -> {:error, :multiple_possible_matches}
    end
  end

  @doc "Discovers as `discover_one/2` does, and raises an error."
  @spec discover_one!([address()], present?()) :: {String.t(), address()}
  def discover_one!(possible, present? \\ &device_present?/2),
    do: value!(discover_one(possible, present?))

  @doc """
  Returns whether a device answers at the address.

  It makes an empty write. Where the adapter does not support one, and at an address of memory
  chips, in which an empty write could change a byte, it makes a read.
  """
  @spec device_present?(t(), address()) :: boolean()
  def device_present?(%__MODULE__{} = bus, address) do
    if :supports_empty_write in bus.flags and not is_memory_chip(address),
      do: write(bus, address, <<>>) == :ok,
      else: match?({:ok, _}, read(bus, address, 1))
  end

  @doc "Returns the name of this module, as Circuits does for its backend."
  @spec info(term()) :: map()
  def info(_backend \\ nil), do: %{backend: __MODULE__}

  defp transfer(bus, function, arguments, retries) do
    case apply(Native, function, arguments) do
      {:error, @ebadf} -> {:error, Error.i2c(@ebadf)}
      {:error, _errno} when retries > 0 -> transfer(bus, function, arguments, retries - 1)
      {:error, errno} -> {:error, error(Error.i2c(errno), bus)}
      result -> result
    end
  end

  # The error of an unplugged adapter depends on its driver.
  defp error(error, _bus) when error in [:i2c_nak, :enxio, :retry], do: error
  defp error(error, bus), do: if(inode(bus.path) == bus.inode, do: error, else: {:errno, @enodev})

  # An adapter that is plugged in again has a new file of the same name.
  defp inode(path) do
    with {:ok, info} <- :file.read_file_info(path, [:raw]), do: elem(info, 11), else: (_ -> nil)
  end

  defp flags(functions),
    do: if(Bitwise.band(functions, @quick) != 0, do: [:supports_empty_write], else: [])

  defp discover_on(name, possible, present?) do
    case open(name) do
      {:ok, bus} ->
        found = for address <- possible, present?.(bus, address), do: {name, address}
        close(bus)
        found

      # In the words of Circuits.I2C, as in value!/1.
      {:error, error} ->
        raise "I2C discovery error: Opening #{name} failed with #{inspect(error)}"
    end
  end

  defp format_found({:error, _error} = error), do: inspect(error)
  defp format_found([]), do: "no device answers"

  defp format_found(addresses),
    do: Enum.map_join(addresses, ", ", &"0x#{Integer.to_string(&1, 16)}")

  # The message has the words of Circuits.I2C.
  defp value!(:ok), do: :ok
  defp value!({:ok, value}), do: value
  defp value!({:error, reason}), do: raise("I2C failure: #{inspect(reason)}")

  defp steps!(timeout) when is_integer(timeout) and timeout < 0, do: nil

  defp steps!(timeout) when is_integer(timeout) and timeout <= @longest_timeout_ms,
    do: max(div(timeout + div(@step_ms, 2), @step_ms), 1)

  defp steps!(other) do
    raise ArgumentError,
          "expected timeout: an integer in milliseconds up to #{@longest_timeout_ms}, " <>
            "got: #{inspect(other)}"
  end

  defp retries!(opts, default) do
    case Keyword.get(opts, :retries, default) do
      retries when is_integer(retries) and retries >= 0 ->
        retries

      other ->
        raise ArgumentError, "expected retries: an integer from 0 on, got: #{inspect(other)}"
    end
  end

  defp address!(address) when address in 0..127, do: address

  defp address!(other),
    do: raise(ArgumentError, "expected a 7-bit address (0..127), got: #{inspect(other)}")

  defp count!(count) when is_integer(count) and count >= 0, do: count

  defp count!(other),
    do: raise(ArgumentError, "expected the number of bytes to read, got: #{inspect(other)}")
end

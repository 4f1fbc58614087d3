defmodule BB.Bus.I2C do
  @moduledoc """
  I2C as drivers see it: the functions, results and errors of `Circuits.I2C` 2, on a bus that all of its sensors share.

      i2c = BB.Bus.I2C.module(opts[:i2c])
      {:ok, bus} = i2c.open("i2c-1", timeout: 20)
      {:ok, <<0x68>>} = i2c.write_read(bus, 0x68, <<0x75>>, 1)

  What talks to the wires is the backend: `Circuits.I2C` where that library is there, as on a board,
  else the simulation, `BB.Bus.Sim.I2C`; `config :ganglion, i2c: …` names another.
  Between it and the drivers stands one process for each bus. It starts with the first `open/2` and ends when the last handle is
  closed; a handle also closes when the process that opened it ends.

  ## What sharing gives
  - Transfers are made one after the other in the order in which they were asked for, so a sensor waits for at most one transfer of each other
    one.
  - The backend is opened once, with the smallest timeout that anybody asked for, in 20..50 ms: nobody holds the bus for longer, nor
    a scheduler's thread.
  - A bus that is stuck (`BB.Bus.I2C.Condition` says when) is closed and opened anew for all of its sensors together, after 10 ms, and from then
    on up to every 100 ms until somebody answers. While it is down calls fail at once.
  - One device that always times out costs the others its timeout, and does not take the bus from them.

  When the application has ended, buses can be opened and used all the same, though nothing is
  shared then: a `disarm/1` makes hardware safe also at that moment.

  ## Errors

  Those of the backend, which for `Circuits.I2C` are

  | term | cause |
  |---|---|
  | `{:error, :bus_not_found}` | `open/2`: no bus of this name |
  | `{:error, :i2c_nak}`, `{:error, :enxio}` | nobody answers at the address, or the device refuses |
  | `{:error, :timeout}` | the bus was held for the whole timeout |
  | `{:error, :retry}` | the bus was lost to another master |
  | `{:error, :not_supported}` | the adapter cannot do this |
  | `{:error, {:errno, n}}` | another error of the kernel |

  and while a bus is down the error that took it down, at once: `:timeout`, or `{:errno, 19}` and then `:bus_not_found` where the adapter
  is gone. A handle that was closed gives `{:error, {:errno, 9}}`. Wrong arguments raise, as the backend does, in the caller.

  ## When not to use it
  A device that holds the bus for longer than 50 ms by design needs a handle of its own: give its driver the backend's module.
  """
  alias BB.Bus.I2C.{Handle, Server}

  @typedoc "An open bus. Any process may use it; it belongs to the one that opened it."
  @type t :: Handle.t()

  @typedoc "A 7-bit device address."
  @type address :: 0..127

  @doc """
  The module that a driver calls: the one that was `given` in its options, which then stands alone, or else this one.

      iex> BB.Bus.I2C.module(nil)
      BB.Bus.I2C
      iex> BB.Bus.I2C.module(BB.Bus.Sim.I2C)
      BB.Bus.Sim.I2C
  """
  @spec module(module() | nil) :: module()
  def module(nil), do: __MODULE__
  def module(given) when is_atom(given), do: given

  @doc """
  The module that talks to the wires: that of `config :ganglion, :i2c`; without it `Circuits.I2C`
  where it can be loaded, or else `BB.Bus.Sim.I2C`.
  """
  @spec backend() :: module()
  def backend, do: Application.get_env(:ganglion, :i2c) || default()

  defp default, do: if(Code.ensure_loaded?(Circuits.I2C), do: Circuits.I2C, else: BB.Bus.Sim.I2C)

  @doc """
  Opens a bus. Options:

  - `:timeout`: how long a device may hold the bus, in milliseconds: 20..50, and the nearest of these for any other; the smallest of all handles
    is that of the bus. Below 0, the default: 50;
  - `:retries`: how often a failed transfer of this handle is tried again, each time as the last one in the queue; default 0;
  - `:backend`: another module than that of `backend/0`;
  - `:clock`: the `t:BB.Clock.t/0` by which a bus that is down waits, default `:real`; that of the first handle counts.

  Others are ignored. A bus that is stuck can be opened.
  """
  @spec open(String.t(), keyword()) :: {:ok, t()} | {:error, term()}
  def open(bus_name, opts \\ []) when is_binary(bus_name) do
    backend = Keyword.get_lazy(opts, :backend, &backend/0)

    handle_options = %{
      timeout: integer!(opts, :timeout, -1),
      retries: retries!(opts, 0),
      clock: Keyword.get(opts, :clock, :real)
    }

    Server.open({backend, bus_name}, handle_options)
  end

  @doc "Reads `count` bytes from the device. `retries:` overrides that of `open/2`."
  @spec read(t(), address(), non_neg_integer(), keyword()) :: {:ok, binary()} | {:error, term()}
  def read(%Handle{} = bus, address, count, opts \\ []),
    do: transfer(bus, :read, address, [count], opts)

  @doc "Writes bytes to the device."
  @spec write(t(), address(), iodata(), keyword()) :: :ok | {:error, term()}
  def write(%Handle{} = bus, address, data, opts \\ []),
    do: transfer(bus, :write, address, [data], opts)

  @doc "Writes bytes and then reads `count`, as one transfer that no other comes between."
  @spec write_read(t(), address(), iodata(), non_neg_integer(), keyword()) ::
          {:ok, binary()} | {:error, term()}
  def write_read(%Handle{} = bus, address, data, count, opts \\ []),
    do: transfer(bus, :write_read, address, [data, count], opts)

  @doc "Closes the handle; once more changes nothing. What others opened stays open."
  @spec close(t()) :: :ok
  def close(%Handle{} = bus), do: Server.close(bus)

  @doc "The names of the backend's buses."
  @spec bus_names() :: [String.t()]
  def bus_names, do: backend().bus_names()

  @doc "The addresses from 0x03 to 0x77 where a device answers. Asking may disturb some devices."
  @spec detect_devices(t() | String.t()) :: [address()] | {:error, term()}
  def detect_devices(%Handle{} = bus), do: Enum.filter(0x03..0x77, &device_present?(bus, &1))

  def detect_devices(bus_name) when is_binary(bus_name) do
    with {:ok, bus} <- open(bus_name) do
      found = detect_devices(bus)
      close(bus)
      found
    end
  end

  @doc "Whether a device answers at the address, as the backend finds out."
  @spec device_present?(t(), address()) :: boolean()
  def device_present?(%Handle{} = bus, address),
    do: Server.transfer(bus, :device_present?, address, []) == true

  @doc """
  How the buses are that are open now, sorted by name; an empty list when none is. Each has

  - `:bus`, its name, and `:backend`;
  - `:state`: `:up`, `:down` (closed for a moment; calls fail at once) or `:trying` (open again, and nobody has answered yet);
  - `:error`: what took it down, `nil` while it is up;
  - `:reopened`: how often it was opened anew after it had been down, since its process started;
  - `:handles`: how many there are.
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
  defdelegate health(), to: Server

  # Each attempt is a transfer of its own: others come between, and none lasts longer than the timeout.
  defp transfer(bus, function, address, arguments, opts) do
    arguments = arguments ++ [[retries: 0]]

    attempt(retries!(opts, bus.retries), fn ->
      Server.transfer(bus, function, address, arguments)
    end)
  end

  defp attempt(retries, transfer) do
    with {:error, _error} when retries > 0 <- transfer.(), do: attempt(retries - 1, transfer)
  end

  defp retries!(opts, default) do
    case integer!(opts, :retries, default) do
      retries when retries >= 0 -> retries
      _ -> raise ArgumentError, "retries must be a non-negative integer"
    end
  end

  defp integer!(opts, key, default) do
    case Keyword.get(opts, key, default) do
      value when is_integer(value) -> value
      other -> raise ArgumentError, "#{key} must be an integer, got: #{inspect(other)}"
    end
  end
end

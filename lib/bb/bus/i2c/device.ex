defmodule BB.Bus.I2C.Device do
  @moduledoc """
  A chip at its address on an I2C bus, for the driver that uses it.

  Use it in a driver for a chip whose registers have an address of one byte. It turns the errors
  of the bus into reasons that name the place. Drivers return them, and `explain/1` formats them
  as sentences.

      BB.Bus.I2C.Device.open(opts, fn device ->
        with :ok <- BB.Bus.I2C.Device.identify(device, 0x75, 0x68),
             :ok <- BB.Bus.I2C.Device.write(device, 0x6B, <<0x01>>),
             do: {:ok, device}
      end)

  `options/1` has the options of `open/1` for a driver's schema, so that every driver has the same
  ones. A simulated chip implements `BB.Bus.Sim.Device`.
  """

  @eacces 13

  @enforce_keys [:i2c, :bus, :bus_name, :address]
  defstruct [:i2c, :bus, :bus_name, :address]

  @typedoc "A device on an open bus, with the I2C module that opened it."
  @type t :: %__MODULE__{i2c: module(), bus: term(), bus_name: String.t(), address: address()}

  @typedoc "A 7-bit address."
  @type address :: 0..127

  @typedoc """
  Why a device does not work. The bus comes first, then the address.

  - `:no_answer`: no device acknowledges the address;
  - `:timeout`: a transfer held the bus for its whole timeout;
  - `:bus_not_found`: no such bus;
  - `:no_rights`: no rights on the bus;
  - `:wrong_chip`: the chip's identity is `found` instead of `expected`;
  - `:not_configured`: the chip did not keep its settings when they were written;
  - `:restarted`: the chip was reset or lost its power while in use;
  - `:bus`: another error of the bus.
  """
  @type reason ::
          {:no_answer, String.t(), address()}
          | {:timeout, String.t(), address()}
          | {:bus_not_found, String.t()}
          | {:no_rights, String.t()}
          | {:wrong_chip, String.t(), address(), found :: identity(), expected :: identity()}
          | {:not_configured, String.t(), address()}
          | {:restarted, String.t(), address()}
          | {:bus, String.t(), address(), error :: term()}

  @typedoc "The identity of a chip: a number of one byte, or the bytes themselves."
  @type identity :: byte() | binary()

  @doc """
  Returns the options of `open/1` for a driver's schema: `:bus`, `:address`, `:timeout` and
  `:i2c`.

  - `:address`: the addresses that the chip can have;
  - `:default`: the default address;
  - `:doc`: how the chip gets another address.
  """
  @spec options(address: Enumerable.t(), default: address(), doc: String.t()) :: keyword()
  def options(opts) do
    [
      bus: [type: :string, required: true, doc: "The I2C bus, such as `\"i2c-1\"`."],
      address: [type: {:in, opts[:address]}, default: opts[:default], doc: opts[:doc] || ""],
      timeout: [
        type: :pos_integer,
        default: 20,
        doc:
          "How long a transfer may hold the bus, in milliseconds. The kernel counts in steps " <>
            "of 10."
      ],
      i2c: [
        type: {:or, [:module, nil]},
        default: nil,
        doc: "The I2C module; when `nil`, the one of `BB.Bus.I2C.module/1`."
      ]
    ]
  end

  @doc "Opens the bus, without a transfer."
  @spec open(keyword()) :: {:ok, t()} | {:error, reason()}
  def open(opts) do
    i2c = BB.Bus.I2C.module(opts[:i2c])
    device = %__MODULE__{i2c: i2c, bus: nil, bus_name: opts[:bus], address: opts[:address]}

    case i2c.open(opts[:bus], timeout: opts[:timeout]) do
      {:ok, bus} -> {:ok, %{device | bus: bus}}
      {:error, {:errno, @eacces}} -> {:error, {:no_rights, device.bus_name}}
      {:error, error} -> error(device, error)
    end
  end

  @doc """
  Opens the bus and returns the result of `prepare`, which sets the chip up.

  It closes the bus again when that is an error.
  """
  @spec open(keyword(), (t() -> {:ok, ready} | {:error, reason})) ::
          {:ok, ready} | {:error, reason() | reason}
        when ready: term(), reason: term()
  def open(opts, prepare) do
    with {:ok, device} <- open(opts), {:error, reason} <- prepare.(device) do
      close(device)
      {:error, reason}
    end
  end

  @doc "Closes the bus."
  @spec close(t()) :: :ok
  def close(device), do: device.i2c.close(device.bus)

  @doc "Reads `count` bytes from `register` on, in one transfer."
  @spec read(t(), register :: byte(), count :: pos_integer()) ::
          {:ok, binary()} | {:error, reason()}
  def read(device, register, count) do
    with {:error, error} <-
           device.i2c.write_read(device.bus, device.address, <<register>>, count),
         do: error(device, error)
  end

  @doc "Writes bytes from `register` on, in one transfer."
  @spec write(t(), register :: byte(), iodata()) :: :ok | {:error, reason()}
  def write(device, register, bytes) do
    with {:error, error} <- device.i2c.write(device.bus, device.address, [register, bytes]),
         do: error(device, error)
  end

  @doc "Checks that a register has the identity `expected`."
  @spec identify(t(), register :: byte(), expected :: identity()) :: :ok | {:error, reason()}
  def identify(device, register, expected) when is_integer(expected) do
    case read(device, register, 1) do
      {:ok, <<^expected>>} -> :ok
      {:ok, <<found>>} -> {:error, fault(device, :wrong_chip, [found, expected])}
      {:error, reason} -> {:error, reason}
    end
  end

  def identify(device, register, expected) do
    case read(device, register, byte_size(expected)) do
      {:ok, ^expected} -> :ok
      {:ok, found} -> {:error, fault(device, :wrong_chip, [found, expected])}
      {:error, reason} -> {:error, reason}
    end
  end

  @doc """
  Checks that `bytes` are in the registers from `register` on, to which they were written.

  Other bytes are an error with the reason of the kind `otherwise`.
  """
  @spec expect(t(), register :: byte(), binary(), otherwise :: atom()) ::
          :ok | {:error, reason()}
  def expect(device, register, bytes, otherwise) do
    case read(device, register, byte_size(bytes)) do
      {:ok, ^bytes} -> :ok
      {:ok, _other} -> {:error, fault(device, otherwise)}
      {:error, reason} -> {:error, reason}
    end
  end

  @doc "Returns whether two devices are at the same address of the same bus."
  @spec same_place?(t(), t()) :: boolean()
  def same_place?(a, b), do: {a.bus_name, a.address} == {b.bus_name, b.address}

  @doc """
  Returns a reason of a kind for this device: one of `t:reason/0`, or one of the driver's own.

      iex> device = %BB.Bus.I2C.Device{i2c: nil, bus: nil, bus_name: "i2c-1", address: 0x36}
      iex> BB.Bus.I2C.Device.fault(device, :restarted)
      {:restarted, "i2c-1", 0x36}
  """
  @spec fault(t(), kind :: atom(), details :: [term()]) :: tuple()
  def fault(device, kind, details \\ []),
    do: List.to_tuple([kind, device.bus_name, device.address | details])

  @doc """
  Formats a reason as a sentence that says what to check.

      iex> BB.Bus.I2C.Device.explain({:no_answer, "i2c-1", 0x68})
      "no answer at 0x68 on i2c-1: check wiring and power"
      iex> BB.Bus.I2C.Device.explain({:restarted, "i2c-1", 0x68})
      "the chip at 0x68 on i2c-1 was reset or lost its power while in use: check its supply"
  """
  @spec explain(reason()) :: String.t()
  def explain({:no_answer, bus, address}),
    do: "no answer at #{place(bus, address)}: check wiring and power"

  def explain({:timeout, bus, address}),
    do:
      "a transfer with #{place(bus, address)} did not end in time: check pull-ups, wiring and " <>
        "the other devices on the bus"

  def explain({:bus_not_found, bus}), do: "no bus #{bus}: check its name, and that it is enabled"

  def explain({:no_rights, bus}), do: bus |> BB.Bus.Linux.path() |> BB.Bus.Linux.Rights.explain()

  def explain({:wrong_chip, bus, address, found, expected}),
    do:
      "the chip at #{place(bus, address)} identifies itself as " <>
        "#{format_identity(found, expected)} instead of " <>
        "#{format_identity(expected, expected)}: check the part and the address"

  def explain({:not_configured, bus, address}),
    do:
      "the chip at #{place(bus, address)} did not keep its settings: check the part, its " <>
        "power, and for a second device at the address"

  def explain({:restarted, bus, address}),
    do:
      "the chip at #{place(bus, address)} was reset or lost its power while in use: check its " <>
        "supply"

  def explain({:bus, bus, address, error}),
    do:
      "a transfer with #{place(bus, address)} failed: #{format_error(error)}; look at the " <>
        "kernel's log"

  defp format_error({:errno, errno}), do: BB.Errno.message(errno)
  defp format_error(error), do: inspect(error)

  @doc """
  Returns the name of a place, for the sentences of a driver's own reasons.

      iex> BB.Bus.I2C.Device.place("i2c-1", 0x36)
      "0x36 on i2c-1"
  """
  @spec place(String.t(), address()) :: String.t()
  def place(bus, address), do: "0x#{Base.encode16(<<address>>)} on #{bus}"

  # In letters or in numbers, as the chip's datasheet writes it.
  defp format_identity(byte, _expected) when is_integer(byte), do: "0x#{Base.encode16(<<byte>>)}"

  defp format_identity(bytes, expected),
    do: if(String.printable?(expected), do: inspect(bytes), else: "0x#{Base.encode16(bytes)}")

  defp error(device, error) when error in [:i2c_nak, :enxio],
    do: {:error, fault(device, :no_answer)}

  defp error(device, :timeout), do: {:error, fault(device, :timeout)}
  defp error(device, :bus_not_found), do: {:error, {:bus_not_found, device.bus_name}}
  defp error(device, error), do: {:error, fault(device, :bus, [error])}
end

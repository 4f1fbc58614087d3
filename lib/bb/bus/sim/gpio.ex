defmodule BB.Bus.Sim.GPIO do
  @moduledoc """
  Simulated GPIO with the interface of `Circuits.GPIO` 2.3: the same names, arities, results,
  messages and error atoms.

  Drivers get it from `BB.Bus.GPIO` where `Circuits.GPIO` is not loaded, as in tests and on a
  laptop.

      gpio = BB.Bus.GPIO.module(opts[:gpio])
      {:ok, line} = gpio.open({"gpiochip0", 17}, :input, pull_mode: :pullup, on_busy: :take_over)
      :ok = gpio.set_interrupts(line, :both)

  `BB.Bus.Sim.Lines` starts the chips, wires devices to them, and breaks them.

  ## Errors

  | term | cause |
  |---|---|
  | `{:error, :not_found}` | no such chip or label |
  | `{:error, :einval}` | the chip has no line of that number; interrupts of an output |
  | `{:error, :already_open}` | the line is open; with `on_busy: :take_over`, in another program of the machine |
  | `{:error, :multiple_controllers}`, `{:error, :duplicate_lines}` | the lines of a group are not different lines of one chip |
  | `{:error, :group_handle}` | `set_interrupts/3` or `status/1` of a group |
  | `{:error, :ebadf}` | the handle is closed, or its line was taken over |
  | `{:error, :enodev}` | the chip was stopped since the line was opened |

  `read/1` and `write/2` return no errors, they raise them: `ErlangError` with `:ebadf`, `:enodev`
  or, for a write to an input, `:pin_not_output`. A wrong argument raises `ArgumentError`.

  ## Differences from real lines

  - A handle is closed a moment after the process that opened it ends. Circuits closes it when it
    is garbage collected.
  - A line that is closed becomes an input and keeps its pull.
  - Timestamps are the time of the chip's clock plus its option `timestamp_offset_ns`.
  """

  alias BB.Bus.GPIO.Arguments
  alias BB.Bus.Sim.GPIO.Server

  require Arguments

  @enforce_keys [:chip, :ref, :locations]
  defstruct [:chip, :ref, :locations]

  @typedoc "An open line or group of lines. Processes may share it. Closing it closes it for all."
  @type t :: %__MODULE__{}

  @typedoc "An index over all lines, a chip and a line, a label, or a chip and a label."
  @type gpio_spec :: Arguments.spec()

  @typedoc "The names of a line. Its `:location` is an unambiguous `t:gpio_spec/0`."
  @type identifiers :: Arguments.identifiers()

  @typedoc "0 or 1; for a group, one bit for each line, with the first line lowest."
  @type value :: non_neg_integer()

  @doc "Returns whether a term looks like a `t:gpio_spec/0`. Allowed in guards."
  defguard is_gpio_spec(x) when Arguments.is_spec(x)

  @doc """
  Returns whether a term looks like a `t:gpio_spec/0`.

      iex> BB.Bus.Sim.GPIO.gpio_spec?({"gpiochip0", 17})
      true
      iex> BB.Bus.Sim.GPIO.gpio_spec?(:led)
      false
  """
  @spec gpio_spec?(term()) :: boolean()
  def gpio_spec?(x), do: is_gpio_spec(x)

  @doc """
  Opens a line, or a list of lines of one chip as a group.

  ## Options

  - `:pull_mode`: `:not_set` (leaves it as it is, the default), `:none`, `:pullup` or `:pulldown`;
  - `:initial_value`: the level of an output; default 0;
  - `:drive_mode`: how an output drives: `:push_pull` (default), `:open_drain` or `:open_source`;
  - `:on_busy`: `:error` (default), or `:take_over` to close other handles of the line.

  Other options are ignored.
  """
  @spec open(
          gpio_spec() | identifiers() | [gpio_spec() | identifiers()],
          :input | :output,
          keyword()
        ) ::
          {:ok, t()} | {:error, atom()}
  def open(spec, direction, opts \\ [])
  def open(%{location: spec}, direction, opts), do: open(spec, direction, opts)

  def open(specs, direction, opts) when is_list(specs) do
    specs = specs |> Enum.map(&Arguments.plain/1) |> Arguments.group!()
    open_all(specs, specs, Arguments.direction!(direction), Arguments.options!(opts))
  end

  def open(spec, direction, opts) do
    spec = Arguments.spec!(spec)
    open_all(spec, [spec], Arguments.direction!(direction), Arguments.options!(opts))
  end

  @doc "Closes the handle. Closing it again has no effect."
  @spec close(t()) :: :ok
  def close(%__MODULE__{chip: chip, ref: ref}), do: Server.call(chip, {:close, ref}, :ok)

  @doc "Closes all handles of the lines."
  @spec force_close(gpio_spec() | identifiers() | [gpio_spec() | identifiers()]) ::
          :ok | {:error, atom()}
  def force_close(specs) do
    specs = specs |> List.wrap() |> Enum.map(&Arguments.plain/1)
    Enum.each(specs, &Arguments.spec!/1)

    Enum.reduce_while(specs, :ok, fn spec, :ok ->
      with {:ok, {chip, offset}} <- locate(spec),
           :ok <- Server.call(chip, {:force_close, offset}) do
        {:cont, :ok}
      else
        error -> {:halt, error}
      end
    end)
  end

  @doc "Returns the level of the line, also of an output."
  @spec read(t()) :: value()
  def read(%__MODULE__{} = handle) do
    {:ok, value} = call!(handle, :read)
    value
  end

  @doc "Opens a line, reads it and closes it."
  @spec read_one(gpio_spec(), keyword()) :: value() | {:error, atom()}
  def read_one(spec, opts \\ []) do
    with {:ok, handle} <- open(spec, :input, opts) do
      value = read(handle)
      :ok = close(handle)
      value
    end
  end

  @doc "Sets the level of an output. Bits beyond its lines are ignored."
  @spec write(t(), value()) :: :ok
  def write(%__MODULE__{} = handle, value),
    do: call!(handle, {:write, Arguments.levels!(value)})

  @doc "Opens a line, sets its level and closes it."
  @spec write_one(gpio_spec(), value(), keyword()) :: :ok | {:error, atom()}
  def write_one(spec, value, opts \\ []) do
    with {:ok, handle} <- open(spec, :output, opts),
         :ok <- write(handle, value),
         do: close(handle)
  end

  @doc """
  Sends the edges of a line: `:rising`, `:falling`, `:both` or `:none`.

  The messages are `{:circuits_gpio, spec, timestamp_ns, level}` with the spec of `open/3`. The
  option `:receiver` is a process or a name, by default the caller. `:suppress_glitches` is
  ignored.
  """
  @spec set_interrupts(t(), :rising | :falling | :both | :none, keyword()) ::
          :ok | {:error, atom()}
  def set_interrupts(handle, trigger, opts \\ [])

  def set_interrupts(%__MODULE__{locations: [_, _ | _]}, _trigger, _opts),
    do: {:error, :group_handle}

  def set_interrupts(%__MODULE__{} = handle, trigger, opts),
    do: call(handle, {:listen, Arguments.trigger!(trigger), nil, Arguments.receiver(opts)})

  @doc """
  Sends the edges of a line or a group, and returns the ref of the messages.

  The messages are
  `{:circuits_gpio, %{ref: ref, timestamp: ns, value: value, previous_value: value}}`.

  ## Options

  - `:tag`: the ref; by default a new reference;
  - `:trigger`: as in `set_interrupts/3`; default `:both`;
  - `:receiver`: a process or a name, by default the caller.
  """
  @spec subscribe(t(), keyword()) :: {:ok, term()} | {:error, atom()}
  def subscribe(%__MODULE__{} = handle, opts \\ []) do
    tag = Keyword.get(opts, :tag) || make_ref()
    trigger = Arguments.trigger!(Keyword.get(opts, :trigger) || :both)

    with :ok <- call(handle, {:listen, trigger, {:tag, tag}, Arguments.receiver(opts)}),
         do: {:ok, tag}
  end

  @doc "Ends the subscription of `subscribe/2`."
  @spec unsubscribe(t()) :: :ok | {:error, atom()}
  def unsubscribe(%__MODULE__{} = handle), do: call(handle, {:listen, :none, nil, self()})

  @doc "Makes the line an `:input` or an `:output`."
  @spec set_direction(t(), :input | :output) :: :ok | {:error, atom()}
  def set_direction(%__MODULE__{} = handle, direction),
    do: call(handle, {:set, :direction, Arguments.direction!(direction)})

  @doc "Sets the pull mode of the line."
  @spec set_pull_mode(t(), :not_set | :none | :pullup | :pulldown) :: :ok | {:error, atom()}
  def set_pull_mode(%__MODULE__{} = handle, pull),
    do: call(handle, {:set, :pull, Arguments.pull!(pull)})

  @doc "Sets the drive mode of the line."
  @spec set_drive_mode(t(), :push_pull | :open_drain | :open_source) :: :ok | {:error, atom()}
  def set_drive_mode(%__MODULE__{} = handle, drive),
    do: call(handle, {:set, :drive, Arguments.drive!(drive)})

  @doc "Returns the lines of all chips."
  @spec enumerate(nil) :: [identifiers()]
  def enumerate(_backend \\ nil),
    do: Enum.flat_map(Server.names(), &Server.call(&1, :identifiers, []))

  @doc "Returns the names of a line."
  @spec identifiers(gpio_spec()) :: {:ok, identifiers()} | {:error, :not_found}
  def identifiers(spec) do
    case Arguments.find(spec, enumerate()) do
      nil -> {:error, :not_found}
      identifiers -> {:ok, identifiers}
    end
  end

  @doc "Returns the settings of a line, given by its spec or its handle, and its consumer."
  @spec status(gpio_spec() | t()) :: {:ok, map()} | {:error, atom()}
  def status(%__MODULE__{locations: [location]}), do: status(location)
  def status(%__MODULE__{}), do: {:error, :group_handle}

  def status(spec) do
    with {:ok, {chip, offset}} <- locate(spec), do: Server.call(chip, {:status, offset})
  end

  @doc "Returns the name of this module, as Circuits does for its backend."
  @spec backend_info(nil) :: map()
  def backend_info(_backend \\ nil), do: %{name: __MODULE__}

  @doc false
  @spec locate(gpio_spec()) :: {:ok, {String.t(), integer()}} | {:error, :not_found}
  def locate({chip, offset} = location) when is_binary(chip) and is_integer(offset) do
    if Server.fetch(chip) == :error, do: location_of(location), else: {:ok, location}
  end

  def locate(spec), do: location_of(spec)

  defp location_of(spec) do
    with {:ok, %{location: location}} <- identifiers(spec), do: {:ok, location}
  end

  defp open_all(spec, specs, direction, opts) do
    with {:ok, chip, offsets} <- specs |> Enum.map(&locate/1) |> Arguments.one_chip(),
         {:ok, pid} <- Server.fetch(chip),
         {:ok, ref} <- Server.call(pid, {:open, spec, offsets, direction, opts}) do
      {:ok, %__MODULE__{chip: pid, ref: ref, locations: Enum.map(offsets, &{chip, &1})}}
    else
      :error -> {:error, :not_found}
      error -> error
    end
  end

  defp call(%__MODULE__{chip: chip, ref: ref}, request),
    do: Server.call(chip, {:handle, ref, request}, {:error, :enodev})

  defp call!(handle, request) do
    with {:error, reason} <- call(handle, request), do: :erlang.error(reason)
  end
end

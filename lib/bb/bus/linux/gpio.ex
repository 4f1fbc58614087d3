defmodule BB.Bus.Linux.GPIO do
  @moduledoc """
  GPIO of a Linux machine, with the interface of `Circuits.GPIO` 2.3: the same names, arities,
  results, messages and error atoms.

  Use it on a machine without Nerves, through `BB.Bus.GPIO`, from which drivers take their module.
  It calls the kernel's GPIO character devices (`/dev/gpiochip0`) by the second version of their
  interface, which needs Linux 5.10 or newer.

      {:ok, line} = BB.Bus.Linux.GPIO.open({"gpiochip0", 17}, :input, pull_mode: :pullup)
      :ok = BB.Bus.Linux.GPIO.set_interrupts(line, :both)
      receive do
        {:circuits_gpio, {"gpiochip0", 17}, timestamp_ns, level} -> {timestamp_ns, level}
      end

  Timestamps are those of the kernel's monotonic clock. All calls run on the dirty I/O schedulers,
  because a chip can be at the other end of an I2C bus. One thread sends the edges of all lines.

  A line is closed by `close/1`, when the process that opened it ends, and when its handle is
  garbage collected. The last two take a moment, so open with `on_busy: :take_over` after a crash.

  ## Errors

  | term | cause |
  |---|---|
  | `{:error, :not_found}` | no such chip or label |
  | `{:error, :eacces}` | no rights on the chip; for a label: on one of the chips |
  | `{:error, :einval}` | the chip has no line of that number, or does not support the settings; interrupts of an output |
  | `{:error, :already_open}` | the line is open; with `on_busy: :take_over`, in another program of the machine |
  | `{:error, :multiple_controllers}`, `{:error, :duplicate_lines}` | the lines of a group are not different lines of one chip |
  | `{:error, :group_handle}` | `set_interrupts/3` or `status/1` of a group |
  | `{:error, :ebadf}` | the handle is closed, or its line was taken over |
  | `{:error, :enodev}` | the chip was unplugged since the line was opened |
  | `{:error, :enotty}` | the file is no chip |
  | `{:error, :not_supported}` | the chip's driver does not support the call |
  | `{:error, atom}` | another error, by its system name |

  `read/1` and `write/2` return no errors, they raise them: `ErlangError` with such an atom, or
  with `:pin_not_output` for a write to an input. A wrong argument raises `ArgumentError`.

  No message reports the end of the edges when their receiver ends or the chip is unplugged.
  `read/1` then raises the reason. The kernel keeps 256 edges. A receiver too slow for more loses
  the newest.

  ## Compared with Circuits

  | function | here |
  |---|---|
  | `open/2,3`, `close/1`, `force_close/1` | the same; `force_enumeration:` has no effect |
  | `read/1`, `write/2`, `read_one/1,2`, `write_one/2,3` | the same |
  | `set_interrupts/2,3`, `subscribe/1,2`, `unsubscribe/1` | the same |
  | `set_direction/2`, `set_pull_mode/2`, `set_drive_mode/2` | the same, and outputs keep their levels, which Circuits sets to 0 |
  | `enumerate/0,1`, `identifiers/1`, `status/1` | the same, without a cache |
  | `gpio_spec?/1`, `is_gpio_spec/1`, `backend_info/0,1` | the same, for this module |
  | an index as spec | the same, without the BeagleBone order of Circuits |
  | a handle | is closed when its process ends; Circuits closes it when it is garbage collected |
  | `Circuits.GPIO.Handle`, `.Diagnostics`, other backends | absent: this module is the interface |
  """

  alias BB.Bus.GPIO.Arguments
  alias BB.Bus.Linux
  alias BB.Bus.Linux.{Error, Native}

  require Arguments

  @enforce_keys [:ref, :spec, :locations]
  defstruct [:ref, :spec, :locations]

  @typedoc "An open line or group of lines. Processes may share it. Closing it closes it for all."
  @type t :: %__MODULE__{}

  @typedoc "An index over all lines, a chip and a line, a label, or a chip and a label."
  @type gpio_spec :: Arguments.spec()

  @typedoc "The names of a line. Its `:location` is an unambiguous `t:gpio_spec/0`."
  @type identifiers :: Arguments.identifiers()

  @typedoc "The settings of a line, and the program that has it open."
  @type status :: %{
          consumer: String.t(),
          direction: :input | :output,
          pull_mode: :none | :pullup | :pulldown,
          drive_mode: :push_pull | :open_drain | :open_source
        }

  @typedoc "0 or 1; for a group, one bit for each line, with the first line lowest."
  @type value :: non_neg_integer()

  @prefix "gpiochip"

  @doc "Returns whether a term looks like a `t:gpio_spec/0`. Allowed in guards."
  defguard is_gpio_spec(x) when Arguments.is_spec(x)

  @doc """
  Returns whether a term looks like a `t:gpio_spec/0`.

      iex> BB.Bus.Linux.GPIO.gpio_spec?({"gpiochip0", 17})
      true
      iex> BB.Bus.Linux.GPIO.gpio_spec?(:led)
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

  @doc "Closes the lines. Closing them again has no effect."
  @spec close(t()) :: :ok
  def close(%__MODULE__{ref: ref}), do: Native.gpio_close(ref)

  @doc "Closes all handles of the lines in this VM."
  @spec force_close(gpio_spec() | identifiers() | [gpio_spec() | identifiers()]) ::
          :ok | {:error, atom()}
  def force_close(specs) do
    specs = specs |> List.wrap() |> Enum.map(&Arguments.plain/1)
    Enum.each(specs, &Arguments.spec!/1)

    Enum.reduce_while(specs, :ok, fn spec, :ok ->
      with {:ok, {chip, offset}} <- locate(spec),
           :ok <- name_error(Native.gpio_force_close(Linux.path(chip), offset)) do
        {:cont, :ok}
      else
        error -> {:halt, error}
      end
    end)
  end

  @doc "Returns the level of the line, also of an output."
  @spec read(t()) :: value()
  def read(%__MODULE__{ref: ref}), do: value!(Native.gpio_read(ref))

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
  def write(%__MODULE__{ref: ref}, value),
    do: value!(Native.gpio_write(ref, Arguments.levels!(value)))

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
    do: listen(handle, :edge, trigger, Arguments.receiver(opts), handle.spec)

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
    trigger = Keyword.get(opts, :trigger) || :both

    with :ok <- listen(handle, :change, trigger, Arguments.receiver(opts), tag), do: {:ok, tag}
  end

  @doc "Ends the subscription of `subscribe/2`."
  @spec unsubscribe(t()) :: :ok | {:error, atom()}
  def unsubscribe(%__MODULE__{} = handle), do: listen(handle, :change, :none, self(), nil)

  @doc """
  Makes the line an `:input` or an `:output`.

  An output has the level that was written last, or the one of `open/3`.
  """
  @spec set_direction(t(), :input | :output) :: :ok | {:error, atom()}
  def set_direction(%__MODULE__{ref: ref}, direction),
    do: name_error(Native.gpio_set_direction(ref, Arguments.direction!(direction)))

  @doc "Sets the pull mode of the line."
  @spec set_pull_mode(t(), :not_set | :none | :pullup | :pulldown) :: :ok | {:error, atom()}
  def set_pull_mode(%__MODULE__{ref: ref}, pull),
    do: name_error(Native.gpio_set_pull(ref, Arguments.pull!(pull)))

  @doc "Sets the drive mode of the line."
  @spec set_drive_mode(t(), :push_pull | :open_drain | :open_source) :: :ok | {:error, atom()}
  def set_drive_mode(%__MODULE__{ref: ref}, drive),
    do: name_error(Native.gpio_set_drive(ref, Arguments.drive!(drive)))

  @doc "Returns the lines of all chips that may be opened, in the order of the chips' numbers."
  @spec enumerate(term()) :: [identifiers()]
  def enumerate(_backend \\ nil) do
    for chip <- Linux.devices(@prefix),
        {:ok, found} <- [read_chip(chip)],
        line <- lines(found),
        do: line
  end

  @doc "Returns the names of a line."
  @spec identifiers(gpio_spec()) :: {:ok, identifiers()} | {:error, atom()}
  def identifiers(spec) do
    case Arguments.find(spec, enumerate()) do
      nil -> {:error, not_found()}
      identifiers -> {:ok, identifiers}
    end
  end

  @doc "Returns the settings of a line, given by its spec or its handle, and its consumer."
  @spec status(gpio_spec() | t()) :: {:ok, status()} | {:error, atom()}
  def status(%__MODULE__{locations: [location]}), do: status(location)
  def status(%__MODULE__{}), do: {:error, :group_handle}

  def status(spec) do
    with {:ok, {chip, offset}} <- locate(spec),
         do: name_error(Native.gpio_status(Linux.path(chip), offset))
  end

  @doc "Returns the name of this module, as Circuits does for its backend."
  @spec backend_info(term()) :: map()
  def backend_info(_backend \\ nil), do: %{name: __MODULE__}

  defp open_all(spec, specs, direction, opts) do
    with {:ok, chip, offsets} <- specs |> Enum.map(&locate/1) |> Arguments.one_chip(),
         {:ok, ref, chip} <- open_lines(Linux.path(chip), offsets, direction, opts) do
      {:ok, %__MODULE__{ref: ref, spec: spec, locations: Enum.map(offsets, &{chip, &1})}}
    end
  end

  # One attempt to take over: a line that is busy then is open in another program, or was opened
  # in between.
  defp open_lines(path, offsets, direction, opts) do
    modes = {opts[:pull_mode], opts[:drive_mode]}
    open = fn -> Native.gpio_open(path, offsets, direction, opts[:initial_value], modes) end

    with {:error, :already_open} <- opened(open.()),
         :take_over <- opts[:on_busy],
         :ok <- close_others(path, offsets) do
      opened(open.())
    else
      :error -> {:error, :already_open}
      other -> other
    end
  end

  defp opened({:ok, {ref, chip}}), do: {:ok, ref, chip}
  defp opened(error), do: name_error(error)

  defp close_others(path, offsets) do
    Enum.reduce_while(offsets, :ok, fn offset, :ok ->
      case name_error(Native.gpio_force_close(path, offset)) do
        :ok -> {:cont, :ok}
        error -> {:halt, error}
      end
    end)
  end

  # A chip's own name is the name of its file, which needs no search.
  defp locate({@prefix <> _ = chip, offset} = location) when is_integer(offset),
    do: if(Linux.name?(chip), do: {:ok, location}, else: {:error, :not_found})

  defp locate(spec) do
    with {:ok, %{location: location}} <- identifiers(spec), do: {:ok, location}
  end

  defp read_chip(chip), do: name_error(Native.gpio_chip(Linux.path(chip)))

  defp lines({chip, label, names}) do
    for {name, offset} <- Enum.with_index(names),
        do: %{location: {chip, offset}, controller: label, label: name}
  end

  # A chip without rights can have the line.
  defp not_found do
    if Enum.any?(Linux.devices(@prefix), &(read_chip(&1) == {:error, :eacces})),
      do: :eacces,
      else: :not_found
  end

  defp listen(handle, form, trigger, receiver, label) do
    trigger = Arguments.trigger!(trigger)
    name_error(Native.gpio_listen(handle.ref, form, trigger, receiver, label))
  end

  defp name_error({:error, errno}) when is_integer(errno), do: {:error, Error.gpio(errno)}
  defp name_error(result), do: result

  defp value!(result) do
    case name_error(result) do
      {:error, reason} -> :erlang.error(reason)
      {:ok, value} -> value
      :ok -> :ok
    end
  end
end

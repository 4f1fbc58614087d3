defmodule BB.Bus.Linux.GPIO do
  @moduledoc """
  GPIO of a Linux machine, with the interface of `Circuits.GPIO` 2.3: the same names, arities,
  results, messages and error atoms. It speaks to the kernel's GPIO character devices
  (`/dev/gpiochip0`, the second version of their interface: Linux 5.10 and newer).

  A driver takes its module from `BB.Bus.GPIO`. Alone it is used like this:

      {:ok, line} = BB.Bus.Linux.GPIO.open({"gpiochip0", 17}, :input, pull_mode: :pullup)
      :ok = BB.Bus.Linux.GPIO.set_interrupts(line, :both)
      receive do: ({:circuits_gpio, {"gpiochip0", 17}, timestamp_ns, level} -> {timestamp_ns, level})

  Timestamps are the kernel's, of its monotonic clock. All calls run on the schedulers for I/O, since
  the chip may be at the other end of an I2C bus. Edges come from one thread, for all lines.

  A line is given back by `close/1`, when the process that opened it ends, and when its handle is
  collected. The last two take a moment: open with `on_busy: :take_over` after a crash.

  ## Errors

  | term | cause |
  |---|---|
  | `{:error, :not_found}` | there is no such chip or label |
  | `{:error, :eacces}` | no rights on the chip; of a label: on one of the chips |
  | `{:error, :einval}` | the chip has no line of that number, or cannot do what was asked; interrupts of an output |
  | `{:error, :already_open}` | somebody has the line open; with `on_busy: :take_over`, another program of the machine |
  | `{:error, :multiple_controllers}`, `{:error, :duplicate_lines}` | a group that cannot be |
  | `{:error, :group_handle}` | `set_interrupts/3` or `status/1` of a group |
  | `{:error, :ebadf}` | the handle is closed, or was taken over |
  | `{:error, :enodev}` | the chip was unplugged since the line was opened |
  | `{:error, :enotty}` | the file is no chip |
  | `{:error, :not_supported}` | the chip's driver cannot do this |
  | `{:error, atom}` | another error, by its system's name |

  `read/1` and `write/2` return no errors, they raise them: `ErlangError` with such an atom, or with
  `:pin_not_output` for a write to an input. A wrong argument raises `ArgumentError`.

  A receiver that ends, and a chip that is unplugged, end the messages without a word: `read/1` then
  says what happened. Who cannot keep up with edges loses the newest of them, as the kernel keeps
  256.

  ## Compared with Circuits

  | function | here |
  |---|---|
  | `open/2,3`, `close/1`, `force_close/1` | the same; `force_enumeration:` changes nothing |
  | `read/1`, `write/2`, `read_one/1,2`, `write_one/2,3` | the same |
  | `set_interrupts/2,3`, `subscribe/1,2`, `unsubscribe/1` | the same |
  | `set_direction/2`, `set_pull_mode/2`, `set_drive_mode/2` | the same, and outputs keep their levels, which Circuits sets to 0 |
  | `enumerate/0,1`, `identifiers/1`, `status/1` | the same, never from a cache |
  | `gpio_spec?/1`, `is_gpio_spec/1`, `backend_info/0,1` | the same, of this module |
  | an index as spec | the same, without Circuits' own order on the BeagleBone |
  | a handle | is closed when its process ends; that of Circuits when it is collected |
  | `Circuits.GPIO.Handle`, `.Diagnostics`, other backends | absent: the module is the interface |
  """

  alias BB.Bus.Linux
  alias BB.Bus.Linux.{Error, Native}
  alias BB.Bus.Linux.GPIO.Arguments

  @enforce_keys [:ref, :spec, :locations]
  defstruct [:ref, :spec, :locations]

  @typedoc "An open line, or a group of lines. It may be shared, and is closed for all who have it."
  @type t :: %__MODULE__{}

  @typedoc "An index over all lines, a chip and a line, a label, or a chip and a label."
  @type gpio_spec ::
          non_neg_integer() | {String.t(), non_neg_integer() | String.t()} | String.t()

  @typedoc "How a line is called: `:location` is a `t:gpio_spec/0` that is not ambiguous."
  @type identifiers :: %{
          location: {String.t(), non_neg_integer()},
          controller: String.t(),
          label: String.t()
        }

  @typedoc "How a line is set, and who has it."
  @type status :: %{
          consumer: String.t(),
          direction: :input | :output,
          pull_mode: :none | :pullup | :pulldown,
          drive_mode: :push_pull | :open_drain | :open_source
        }

  @typedoc "0 or 1; of a group, one bit a line, the first line's lowest."
  @type value :: non_neg_integer()

  @prefix "gpiochip"

  @doc "Whether a term looks like a `t:gpio_spec/0`, in guards too."
  defguard is_gpio_spec(x)
           when (is_tuple(x) and is_binary(elem(x, 0)) and
                   (is_binary(elem(x, 1)) or is_integer(elem(x, 1)))) or is_binary(x) or
                  is_integer(x)

  @doc """
  Whether a term looks like a `t:gpio_spec/0`.

      iex> BB.Bus.Linux.GPIO.gpio_spec?({"gpiochip0", 17})
      true
      iex> BB.Bus.Linux.GPIO.gpio_spec?(:led)
      false
  """
  @spec gpio_spec?(term()) :: boolean()
  def gpio_spec?(x), do: is_gpio_spec(x)

  @doc """
  Opens a line, or a list of lines of one chip as a group. Options:

  - `:pull_mode`: `:not_set` (as it was, the default), `:none`, `:pullup` or `:pulldown`;
  - `:initial_value`: of an output; default 0;
  - `:drive_mode`: of an output: `:push_pull` (default), `:open_drain` or `:open_source`;
  - `:on_busy`: `:error` (default), or `:take_over` to close other handles of the line.

  Others are ignored.
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
    specs = specs |> Enum.map(&plain/1) |> Arguments.group!()
    open_all(specs, specs, Arguments.direction!(direction), Arguments.options!(opts))
  end

  def open(spec, direction, opts) do
    spec = Arguments.spec!(spec)
    open_all(spec, [spec], Arguments.direction!(direction), Arguments.options!(opts))
  end

  @doc "Gives the lines back; once more changes nothing."
  @spec close(t()) :: :ok
  def close(%__MODULE__{ref: ref}), do: Native.gpio_close(ref)

  @doc "Closes whatever handles there are of lines, in this VM."
  @spec force_close(gpio_spec() | identifiers() | [gpio_spec() | identifiers()]) ::
          :ok | {:error, atom()}
  def force_close(specs) do
    specs = specs |> List.wrap() |> Enum.map(&plain/1)
    Enum.each(specs, &Arguments.spec!/1)

    Enum.reduce_while(specs, :ok, fn spec, :ok ->
      with {:ok, {chip, offset}} <- locate(spec),
           :ok <- named(Native.gpio_force_close(Linux.path(chip), offset)) do
        {:cont, :ok}
      else
        error -> {:halt, error}
      end
    end)
  end

  @doc "The level of the line, also of an output."
  @spec read(t()) :: value()
  def read(%__MODULE__{ref: ref}), do: raised(Native.gpio_read(ref))

  @doc "Opens a line, reads and closes it."
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
    do: raised(Native.gpio_write(ref, Arguments.levels!(value)))

  @doc "Opens a line, sets its level and closes it."
  @spec write_one(gpio_spec(), value(), keyword()) :: :ok | {:error, atom()}
  def write_one(spec, value, opts \\ []) do
    with {:ok, handle} <- open(spec, :output, opts),
         :ok <- write(handle, value),
         do: close(handle)
  end

  @doc """
  Has edges told: `:rising`, `:falling`, `:both` or `:none`, as `{:circuits_gpio, spec, timestamp_ns, level}`
  with the spec of `open/3`.

  `receiver:` is a process or a name, the caller when not given. `:suppress_glitches` is ignored.
  """
  @spec set_interrupts(t(), :rising | :falling | :both | :none, keyword()) ::
          :ok | {:error, atom()}
  def set_interrupts(handle, trigger, opts \\ [])

  def set_interrupts(%__MODULE__{locations: [_, _ | _]}, _trigger, _opts),
    do: {:error, :group_handle}

  def set_interrupts(%__MODULE__{} = handle, trigger, opts),
    do: listen(handle, :edge, trigger, receiver(opts), handle.spec)

  @doc """
  Has edges told, also of a group: `{:circuits_gpio, %{ref: ref, timestamp: ns, value: value, previous_value: value}}`.

  The ref is in the result, and is `tag:` where that is given; `trigger:` is `:both` when not given,
  `receiver:` the caller.
  """
  @spec subscribe(t(), keyword()) :: {:ok, term()} | {:error, atom()}
  def subscribe(%__MODULE__{} = handle, opts \\ []) do
    tag = Keyword.get(opts, :tag) || make_ref()
    trigger = Keyword.get(opts, :trigger) || :both

    with :ok <- listen(handle, :change, trigger, receiver(opts), tag), do: {:ok, tag}
  end

  @doc "Ends what `subscribe/2` began."
  @spec unsubscribe(t()) :: :ok | {:error, atom()}
  def unsubscribe(%__MODULE__{} = handle), do: listen(handle, :change, :none, self(), nil)

  @doc """
  Makes it an `:input` or an `:output`, with the level that it was opened with or that was written
  last.
  """
  @spec set_direction(t(), :input | :output) :: :ok | {:error, atom()}
  def set_direction(%__MODULE__{ref: ref}, direction),
    do: named(Native.gpio_set_direction(ref, Arguments.direction!(direction)))

  @doc "Sets its pull."
  @spec set_pull_mode(t(), :not_set | :none | :pullup | :pulldown) :: :ok | {:error, atom()}
  def set_pull_mode(%__MODULE__{ref: ref}, pull),
    do: named(Native.gpio_set_pull(ref, Arguments.pull!(pull)))

  @doc "Sets how it drives."
  @spec set_drive_mode(t(), :push_pull | :open_drain | :open_source) :: :ok | {:error, atom()}
  def set_drive_mode(%__MODULE__{ref: ref}, drive),
    do: named(Native.gpio_set_drive(ref, Arguments.drive!(drive)))

  @doc "All lines of all chips that may be opened, in the order of the chips' numbers."
  @spec enumerate(term()) :: [identifiers()]
  def enumerate(_backend \\ nil) do
    for chip <- Linux.devices(@prefix),
        {:ok, found} <- [chip(chip)],
        line <- lines(found),
        do: line
  end

  @doc "How a line is called."
  @spec identifiers(gpio_spec()) :: {:ok, identifiers()} | {:error, atom()}
  def identifiers(index) when is_integer(index) and index >= 0,
    do: found(Enum.at(enumerate(), index))

  def identifiers(label) when is_binary(label),
    do: found(Enum.find(enumerate(), &(&1.label == label)))

  def identifiers({controller, at}) do
    found(
      Enum.find(enumerate(), fn %{location: {chip, offset}} = line ->
        controller in [chip, line.controller] and at in [offset, line.label]
      end)
    )
  end

  def identifiers(_spec), do: {:error, :not_found}

  @doc "How a line, by its spec or its handle, is set, and who has it."
  @spec status(gpio_spec() | t()) :: {:ok, status()} | {:error, atom()}
  def status(%__MODULE__{locations: [location]}), do: status(location)
  def status(%__MODULE__{}), do: {:error, :group_handle}

  def status(spec) do
    with {:ok, {chip, offset}} <- locate(spec),
         do: named(Native.gpio_status(Linux.path(chip), offset))
  end

  @doc "What this is."
  @spec backend_info(term()) :: map()
  def backend_info(_backend \\ nil), do: %{name: __MODULE__}

  defp open_all(spec, specs, direction, opts) do
    with {:ok, chip, offsets} <- resolve(specs),
         {:ok, ref, chip} <- ask(Linux.path(chip), offsets, direction, opts) do
      {:ok, %__MODULE__{ref: ref, spec: spec, locations: Enum.map(offsets, &{chip, &1})}}
    end
  end

  # Taking over is tried once: who then has the line is another program, or opens it in this moment.
  defp ask(path, offsets, direction, opts) do
    modes = {opts[:pull_mode], opts[:drive_mode]}
    ask = fn -> Native.gpio_open(path, offsets, direction, opts[:initial_value], modes) end

    with {:error, :already_open} <- asked(ask.()),
         :take_over <- opts[:on_busy],
         :ok <- take_over(path, offsets) do
      asked(ask.())
    else
      :error -> {:error, :already_open}
      other -> other
    end
  end

  defp asked({:ok, {ref, chip}}), do: {:ok, ref, chip}
  defp asked(error), do: named(error)

  defp take_over(path, offsets) do
    Enum.reduce_while(offsets, :ok, fn offset, :ok ->
      case named(Native.gpio_force_close(path, offset)) do
        :ok -> {:cont, :ok}
        error -> {:halt, error}
      end
    end)
  end

  defp resolve(specs) do
    located = Enum.map(specs, &locate/1)

    with nil <- Enum.find(located, &match?({:error, _}, &1)) do
      {chips, offsets} = located |> Enum.map(&elem(&1, 1)) |> Enum.unzip()

      cond do
        length(Enum.uniq(chips)) > 1 -> {:error, :multiple_controllers}
        offsets != Enum.uniq(offsets) -> {:error, :duplicate_lines}
        true -> {:ok, hd(chips), offsets}
      end
    end
  end

  # A chip's own name is that of its file, and need not be looked for.
  defp locate({@prefix <> _ = chip, offset} = location) when is_integer(offset),
    do: if(Linux.name?(chip), do: {:ok, location}, else: {:error, :not_found})

  defp locate(spec) do
    with {:ok, %{location: location}} <- identifiers(spec), do: {:ok, location}
  end

  defp chip(chip), do: named(Native.gpio_chip(Linux.path(chip)))

  defp lines({chip, label, names}) do
    for {name, offset} <- Enum.with_index(names),
        do: %{location: {chip, offset}, controller: label, label: name}
  end

  # What may not be looked at may have what was looked for.
  defp found(nil) do
    if Enum.any?(Linux.devices(@prefix), &(chip(&1) == {:error, :eacces})),
      do: {:error, :eacces},
      else: {:error, :not_found}
  end

  defp found(identifiers), do: {:ok, identifiers}

  defp listen(handle, form, trigger, receiver, label) do
    trigger = Arguments.trigger!(trigger)
    named(Native.gpio_listen(handle.ref, form, trigger, receiver, label))
  end

  defp named({:error, errno}) when is_integer(errno), do: {:error, Error.gpio(errno)}
  defp named(result), do: result

  defp raised(result) do
    case named(result) do
      {:error, reason} -> :erlang.error(reason)
      {:ok, value} -> value
      :ok -> :ok
    end
  end

  defp receiver(opts) do
    case Keyword.get(opts, :receiver) do
      pid when is_pid(pid) -> pid
      name when is_atom(name) and name != nil -> Process.whereis(name) || self()
      _other -> self()
    end
  end

  defp plain(%{location: spec}), do: spec
  defp plain(spec), do: spec
end

defmodule BB.Bus.Sim.GPIO do
  @moduledoc """
  Simulated GPIO with the interface of `Circuits.GPIO` 2.3: the same names, arities, results, messages and error atoms.

  A driver takes its module from `BB.Bus.GPIO` and so runs on either:

      gpio = BB.Bus.GPIO.module(opts[:gpio])
      {:ok, line} = gpio.open({"gpiochip0", 17}, :input, pull_mode: :pullup, on_busy: :take_over)
      :ok = gpio.set_interrupts(line, :both)

  The chips are made, and their wires held and broken, by `BB.Bus.Sim.Lines`.

  ## Errors

  | term | cause |
  |---|---|
  | `{:error, :not_found}` | there is no such chip or label |
  | `{:error, :einval}` | the chip has no line of that number; interrupts of an output |
  | `{:error, :already_open}` | somebody has the line open; with `on_busy: :take_over`, another program of the machine has it |
  | `{:error, :multiple_controllers}`, `{:error, :duplicate_lines}` | a group that cannot be |
  | `{:error, :group_handle}` | `set_interrupts/3` or `status/1` of a group |
  | `{:error, :ebadf}` | the handle is closed, or was taken over |
  | `{:error, :enodev}` | the chip was stopped since the line was opened |

  `read/1` and `write/2` return no errors, they raise them: `ErlangError` with `:ebadf`, `:enodev` or (a write to an input) `:pin_not_output`. A wrong argument raises `ArgumentError`.

  ## What differs

  - A handle is closed when the process that opened it ends, a moment after it has; a real one when it is collected.
  - A line that is closed becomes an input and keeps its pull.
  - The time of a message is that of the chip's clock, and its option `timestamp_offset_ns` more.
  """

  alias BB.Bus.Sim.GPIO.Chip

  @enforce_keys [:chip, :ref, :locations]
  defstruct [:chip, :ref, :locations]

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

  @typedoc "0 or 1; of a group, one bit a line, the first line's lowest."
  @type value :: non_neg_integer()

  @pulls [:not_set, :pullup, :pulldown, :none]
  @drives [:push_pull, :open_drain, :open_source]
  @triggers [:rising, :falling, :both, :none]
  @most_lines 64
  @defaults [initial_value: 0, pull_mode: :not_set, drive_mode: :push_pull, on_busy: :error]

  @doc "Whether a term looks like a `t:gpio_spec/0`, in guards too."
  defguard is_gpio_spec(x)
           when (is_tuple(x) and is_binary(elem(x, 0)) and
                   (is_binary(elem(x, 1)) or is_integer(elem(x, 1)))) or is_binary(x) or
                  is_integer(x)

  @doc """
  Whether a term looks like a `t:gpio_spec/0`.

      iex> BB.Bus.Sim.GPIO.gpio_spec?({"gpiochip0", 17})
      true
      iex> BB.Bus.Sim.GPIO.gpio_spec?(:led)
      false
  """
  @spec gpio_spec?(term()) :: boolean()
  def gpio_spec?(x), do: is_gpio_spec(x)

  @doc """
  Opens a line, or a list of lines of one chip as a group. Options:

  - `:pull_mode`: `:not_set` (as it was, the default), `:none`, `:pullup` or `:pulldown`;
  - `:initial_value`: of an output; default 0;
  - `:drive_mode`: `:push_pull` (default), `:open_drain` or `:open_source`;
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
    specs = Enum.map(specs, &plain/1)
    check_group!(specs)
    open_all(specs, specs, direction, opts)
  end

  def open(spec, direction, opts), do: open_all(check_spec!(spec), [spec], direction, opts)

  @doc "Closes the handle; once more changes nothing."
  @spec close(t()) :: :ok
  def close(%__MODULE__{chip: chip, ref: ref}), do: Chip.ask(chip, {:close, ref}, :ok)

  @doc "Closes whatever handles there are of lines."
  @spec force_close(gpio_spec() | identifiers() | [gpio_spec() | identifiers()]) ::
          :ok | {:error, atom()}
  def force_close(specs) do
    specs = specs |> List.wrap() |> Enum.map(&plain/1)
    Enum.each(specs, &check_spec!/1)

    Enum.reduce_while(specs, :ok, fn spec, :ok ->
      with {:ok, {chip, offset}} <- locate(spec),
           :ok <- Chip.ask(chip, {:force_close, offset}) do
        {:cont, :ok}
      else
        error -> {:halt, error}
      end
    end)
  end

  @doc "The level of the line, also of an output."
  @spec read(t()) :: value()
  def read(%__MODULE__{} = handle) do
    {:ok, value} = operate!(handle, :read)
    value
  end

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
  def write(%__MODULE__{} = handle, value) when is_integer(value) and value >= 0,
    do: operate!(handle, {:write, value})

  def write(_handle, value),
    do: raise(ArgumentError, "expected a value of 0 or 1, got: #{inspect(value)}")

  @doc "Opens a line, sets its level and closes it."
  @spec write_one(gpio_spec(), value(), keyword()) :: :ok | {:error, atom()}
  def write_one(spec, value, opts \\ []) do
    with {:ok, handle} <- open(spec, :output, opts),
         :ok <- write(handle, value),
         do: close(handle)
  end

  @doc """
  Has edges told: `:rising`, `:falling`, `:both` or `:none`, as `{:circuits_gpio, spec, timestamp_ns, level}` with the spec of `open/3`.

  `receiver:` is a process or a name, the caller when not given. `:suppress_glitches` is ignored.
  """
  @spec set_interrupts(t(), :rising | :falling | :both | :none, keyword()) ::
          :ok | {:error, atom()}
  def set_interrupts(handle, trigger, opts \\ [])

  def set_interrupts(%__MODULE__{locations: [_, _ | _]}, _trigger, _opts),
    do: {:error, :group_handle}

  def set_interrupts(%__MODULE__{} = handle, trigger, opts),
    do: operate(handle, {:listen, trigger!(trigger), nil, receiver(opts)})

  @doc """
  Has edges told, also of a group: `{:circuits_gpio, %{ref: ref, timestamp: ns, value: value, previous_value: value}}`.

  The ref is in the result, and is `tag:` where that is given; `trigger:` is `:both` when not given, `receiver:` the caller.
  """
  @spec subscribe(t(), keyword()) :: {:ok, term()} | {:error, atom()}
  def subscribe(%__MODULE__{} = handle, opts \\ []) do
    tag = Keyword.get(opts, :tag) || make_ref()
    trigger = trigger!(Keyword.get(opts, :trigger) || :both)

    with :ok <- operate(handle, {:listen, trigger, {:tag, tag}, receiver(opts)}),
         do: {:ok, tag}
  end

  @doc "Ends what `subscribe/2` began."
  @spec unsubscribe(t()) :: :ok | {:error, atom()}
  def unsubscribe(%__MODULE__{} = handle), do: operate(handle, {:listen, :none, nil, self()})

  @doc "Makes it an `:input` or an `:output`."
  @spec set_direction(t(), :input | :output) :: :ok | {:error, atom()}
  def set_direction(%__MODULE__{} = handle, direction),
    do: operate(handle, {:set, :direction, direction!(direction)})

  @doc "Sets its pull."
  @spec set_pull_mode(t(), :not_set | :none | :pullup | :pulldown) :: :ok | {:error, atom()}
  def set_pull_mode(%__MODULE__{} = handle, pull) when pull in @pulls,
    do: operate(handle, {:set, :pull, pull})

  @doc "Sets how it drives."
  @spec set_drive_mode(t(), :push_pull | :open_drain | :open_source) :: :ok | {:error, atom()}
  def set_drive_mode(%__MODULE__{} = handle, drive) when drive in @drives,
    do: operate(handle, {:set, :drive, drive})

  @doc "All lines of all chips."
  @spec enumerate(nil) :: [identifiers()]
  def enumerate(_backend \\ nil), do: Enum.flat_map(Chip.names(), &Chip.ask(&1, :identifiers, []))

  @doc "How a line is called."
  @spec identifiers(gpio_spec()) :: {:ok, identifiers()} | {:error, :not_found}
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
  @spec status(gpio_spec() | t()) :: {:ok, map()} | {:error, atom()}
  def status(%__MODULE__{locations: [location]}), do: status(location)
  def status(%__MODULE__{}), do: {:error, :group_handle}

  def status(spec) do
    with {:ok, {chip, offset}} <- locate(spec), do: Chip.ask(chip, {:status, offset})
  end

  @doc "What this is."
  @spec backend_info(nil) :: map()
  def backend_info(_backend \\ nil), do: %{name: __MODULE__}

  @doc false
  @spec locate(gpio_spec()) :: {:ok, {String.t(), integer()}} | {:error, :not_found}
  def locate({chip, offset} = location) when is_binary(chip) and is_integer(offset) do
    if Chip.fetch(chip) == :error, do: named(location), else: {:ok, location}
  end

  def locate(spec), do: named(spec)

  defp named(spec) do
    with {:ok, %{location: location}} <- identifiers(spec), do: {:ok, location}
  end

  defp found(nil), do: {:error, :not_found}
  defp found(identifiers), do: {:ok, identifiers}

  defp open_all(spec, specs, direction, opts) do
    direction!(direction)
    _ = check_options!(opts)
    opts = Keyword.merge(@defaults, opts)

    with {:ok, chip, offsets} <- resolve(specs),
         {:ok, pid} <- Chip.fetch(chip),
         {:ok, ref} <- Chip.ask(pid, {:open, spec, offsets, direction, opts}) do
      {:ok, %__MODULE__{chip: pid, ref: ref, locations: Enum.map(offsets, &{chip, &1})}}
    else
      :error -> {:error, :not_found}
      error -> error
    end
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

  defp operate(%__MODULE__{chip: chip, ref: ref}, request),
    do: Chip.ask(chip, {:handle, ref, request}, {:error, :enodev})

  defp operate!(handle, request) do
    with {:error, reason} <- operate(handle, request), do: :erlang.error(reason)
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

  defp check_spec!(spec) when is_gpio_spec(spec), do: spec
  defp check_spec!(spec), do: raise(ArgumentError, "Invalid GPIO spec: #{inspect(spec)}")

  defp check_group!([]), do: raise(ArgumentError, "Expected a non-empty list of GPIO specs")

  defp check_group!(specs) when length(specs) > @most_lines,
    do: raise(ArgumentError, "A GPIO group is limited to #{@most_lines} lines")

  defp check_group!(specs), do: Enum.each(specs, &check_spec!/1)

  defp direction!(direction) when direction in [:input, :output], do: direction

  defp direction!(other) do
    raise ArgumentError, "Invalid direction: #{inspect(other)}. Options are :input or :output"
  end

  defp trigger!(trigger) when trigger in @triggers, do: trigger
  defp trigger!(other), do: raise(ArgumentError, "Invalid trigger: #{inspect(other)}")

  defp check_options!(opts) do
    for {key, value} <- opts, expected = expected(key, value), do: raise(ArgumentError, expected)
  end

  defp expected(:initial_value, value)
       when value == :not_set or (is_integer(value) and value >= 0),
       do: nil

  defp expected(:initial_value, _value),
    do: ":initial_value should be 0 or 1 (or an integer with one bit per line for a group)"

  defp expected(:pull_mode, value) when value not in @pulls,
    do: ":pull_mode should be :not_set, :pullup, :pulldown, or :none"

  defp expected(:drive_mode, value) when value not in @drives,
    do: ":drive_mode should be :push_pull, :open_drain, or :open_source"

  defp expected(:on_busy, value) when value not in [:take_over, :error],
    do: ":on_busy should be :take_over or :error"

  defp expected(_key, _value), do: nil
end

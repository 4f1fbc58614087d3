defmodule BB.Bus.GPIO.Line do
  @moduledoc """
  A GPIO line, or a group of lines, for the driver that uses it.

  Use it in a driver: it turns the errors and exceptions of the GPIO module into reasons that name
  the line. Drivers return them, and `explain/1` formats them as sentences.

      alias BB.Bus.GPIO.Line

      {:ok, line} = Line.open(opts[:gpio], {"gpiochip0", 17}, :input, pull_mode: :pullup)
      {:ok, level} = Line.read(line)
  """

  alias BB.Bus.GPIO

  @enforce_keys [:gpio, :handle, :spec]
  defstruct [:gpio, :handle, :spec]

  @typedoc "An open line or group, with the GPIO module that opened it."
  @type t :: %__MODULE__{gpio: module(), handle: term(), spec: spec() | [spec()]}

  @typedoc """
  A chip and a line, a label, a chip and a label, or an index over all lines. The first is the
  clearest.
  """
  @type spec :: {String.t(), non_neg_integer() | String.t()} | String.t() | non_neg_integer()

  @typedoc """
  Why a line does not work:

  - `:line_not_found`: no such line;
  - `:no_rights`: no rights on its chip;
  - `:line_busy`: another program has it open;
  - `:line_lost`: it was taken over, or its chip is gone;
  - `:noise`: its level changes all the time;
  - `:line`: another error of the GPIO module.
  """
  @type reason ::
          {:line_not_found, spec() | [spec()]}
          | {:no_rights, spec() | [spec()]}
          | {:line_busy, spec() | [spec()]}
          | {:line_lost, spec() | [spec()]}
          | {:noise, spec() | [spec()]}
          | {:line, spec() | [spec()], error :: term()}

  # A bouncing contact makes fewer edges in this time.
  @quiet_ms 20
  @most_edges 10

  @doc "Returns the option `:gpio`, which every driver on lines has, for its schema."
  @spec options() :: keyword()
  def options do
    [
      gpio: [
        type: {:or, [:module, nil]},
        default: nil,
        doc: "The GPIO module; when `nil`, the one of `BB.Bus.GPIO.module/1`."
      ]
    ]
  end

  @doc "Returns an option for a line, for a driver's schema."
  @spec option(String.t()) :: keyword()
  def option(doc) do
    [
      type: {:custom, __MODULE__, :check_spec, []},
      required: true,
      type_doc: "`t:BB.Bus.GPIO.Line.spec/0`",
      doc: doc
    ]
  end

  @doc false
  def check_spec(spec) do
    case spec do
      {chip, at} when is_binary(chip) and (is_binary(at) or (is_integer(at) and at >= 0)) ->
        {:ok, spec}

      label when is_binary(label) ->
        {:ok, spec}

      index when is_integer(index) and index >= 0 ->
        {:ok, spec}

      other ->
        {:error,
         "expected a line, such as {\"gpiochip0\", 17}, \"GPIO17\" or " <>
           "{\"gpiochip0\", \"GPIO17\"}, got: #{inspect(other)}"}
    end
  end

  @doc """
  Opens a line, or a list of lines as a group, with the options of `BB.Bus.GPIO`.

  It closes the handle that a process which died has left behind.
  """
  @spec open(module() | nil, spec() | [spec()], :input | :output, keyword()) ::
          {:ok, t()} | {:error, reason()}
  def open(gpio, spec, direction, opts) do
    gpio = GPIO.module(gpio)

    case gpio.open(spec, direction, [on_busy: :take_over] ++ opts) do
      {:ok, handle} -> {:ok, %__MODULE__{gpio: gpio, handle: handle, spec: spec}}
      {:error, error} -> {:error, reason(error, spec)}
    end
  end

  @doc "Closes the line, and removes its edges from the mailbox."
  @spec close(t()) :: :ok
  def close(line) do
    :ok = line.gpio.close(line.handle)
    flush_edges(line)
  end

  @doc "Reads the level. A group has one bit for each line, with the first line lowest."
  @spec read(t()) :: {:ok, non_neg_integer()} | {:error, reason()}
  def read(line), do: rescue_error(line, fn -> {:ok, line.gpio.read(line.handle)} end)

  @doc "Sets the level of an output."
  @spec write(t(), 0 | 1) :: :ok | {:error, reason()}
  def write(line, level), do: rescue_error(line, fn -> line.gpio.write(line.handle, level) end)

  @doc """
  Sends the edges to the calling process, or ends them with `:none`.

  The messages are `{:circuits_gpio, spec, timestamp_ns, level}`. Earlier ones are removed from
  the mailbox.
  """
  @spec listen(t(), :both | :rising | :falling | :none) :: :ok | {:error, reason()}
  def listen(line, trigger) do
    with :ok <- put_reason(line, line.gpio.set_interrupts(line.handle, trigger)),
         do: flush_edges(line)
  end

  @doc """
  Sends the edges of a group to the calling process.

  The messages are
  `{:circuits_gpio, %{ref: tag, timestamp: ns, value: value, previous_value: value}}`.
  """
  @spec subscribe(t(), tag :: term()) :: :ok | {:error, reason()}
  def subscribe(line, tag) do
    with {:ok, ^tag} <- put_reason(line, line.gpio.subscribe(line.handle, tag: tag)), do: :ok
  end

  @doc """
  Checks that an input is quiet: that it has at most #{@most_edges} edges in #{@quiet_ms} ms.

  It waits for that time. From then on the calling process gets `:both` edges.
  """
  @spec check_quiet(t()) :: :ok | {:error, reason()}
  def check_quiet(line) do
    with :ok <- listen(line, :both) do
      Process.sleep(@quiet_ms)
      with {:ok, _level} <- read(line), do: check_edges(line, take_edges(line.spec, 0))
    end
  end

  defp check_edges(line, edges) when edges > @most_edges, do: {:error, {:noise, line.spec}}
  defp check_edges(_line, _edges), do: :ok

  @doc """
  Opens a line with `open` and returns the result of `prepare` for it.

  It closes the line again when that is an error.
  """
  @spec open_with(
          (() -> {:ok, t()} | {:error, reason()}),
          (t() -> {:ok, ready} | {:error, term()})
        ) ::
          {:ok, ready} | {:error, term()}
        when ready: term()
  def open_with(open, prepare) do
    with {:ok, line} <- open.(), {:error, reason} <- prepare.(line) do
      close(line)
      {:error, reason}
    end
  end

  @doc """
  Formats a reason as a sentence that says what to check.

      iex> BB.Bus.GPIO.Line.explain({:line_busy, {"gpiochip0", 17}})
      "line 17 of gpiochip0 is in use: find the other program or device tree entry that has it"
      iex> BB.Bus.GPIO.Line.explain({:noise, "BUMPER"})
      "line BUMPER changes all the time: check its wire, its ground and its pull resistor"
  """
  @spec explain(reason()) :: String.t()
  def explain({:line_not_found, spec}),
    do: "no #{name(spec)}: check its name, and that its chip is enabled"

  def explain({:no_rights, spec}),
    do: "#{name(spec)}: " <> BB.Bus.Linux.Rights.explain(chip(spec))

  def explain({:line_busy, spec}),
    do: "#{name(spec)} is in use: find the other program or device tree entry that has it"

  def explain({:line_lost, spec}),
    do: "#{name(spec)} was taken away: check what else opens it, and the chip's connection"

  def explain({:noise, spec}),
    do: "#{name(spec)} changes all the time: check its wire, its ground and its pull resistor"

  def explain({:line, spec, error}),
    do: "#{name(spec)} fails with #{inspect(error)}: look at the kernel's log"

  @doc """
  Returns the name of a line or a group, for a sentence.

      iex> BB.Bus.GPIO.Line.name([{"gpiochip0", 5}, {"gpiochip0", "ENC_B"}])
      "line 5 of gpiochip0 and line ENC_B of gpiochip0"
  """
  @spec name(spec() | [spec()]) :: String.t()
  def name(specs) when is_list(specs), do: Enum.map_join(specs, " and ", &name/1)
  def name({chip, at}), do: "line #{at} of #{chip}"
  def name(at), do: "line #{at}"

  # All chips of a machine belong to one group of users, so any chip will do for a label.
  defp chip([spec | _]), do: chip(spec)
  defp chip({"gpiochip" <> _ = chip, _at}), do: BB.Bus.Linux.path(chip)

  defp chip(_spec),
    do: BB.Bus.Linux.path(List.first(BB.Bus.Linux.devices("gpiochip")) || "gpiochip0")

  # read/1 and write/2 of the GPIO module raise their errors.
  defp rescue_error(line, fun) do
    fun.()
  rescue
    error in ErlangError -> {:error, reason(error.original, line.spec)}
  end

  defp put_reason(line, {:error, error}), do: {:error, reason(error, line.spec)}
  defp put_reason(_line, result), do: result

  defp reason(error, spec) when error in [:not_found, :einval], do: {:line_not_found, spec}
  defp reason(:eacces, spec), do: {:no_rights, spec}
  defp reason(:already_open, spec), do: {:line_busy, spec}
  defp reason(error, spec) when error in [:ebadf, :enodev], do: {:line_lost, spec}
  defp reason(error, spec), do: {:line, spec, error}

  defp flush_edges(%{spec: spec}) do
    _ = take_edges(spec, 0)
    :ok
  end

  defp take_edges(spec, count) do
    receive do
      {:circuits_gpio, ^spec, _time_ns, _level} -> take_edges(spec, count + 1)
    after
      0 -> count
    end
  end
end

defmodule BB.Bus.GPIO.Line do
  @moduledoc """
  A line, or a group of lines, as its driver sees it.

      {:ok, line} = BB.Bus.GPIO.Line.open(opts[:gpio], {"gpiochip0", 17}, :input, pull_mode: :pullup)
      {:ok, level} = BB.Bus.GPIO.Line.read(line)

  It turns what the bus says, or raises, into reasons that name the line, which drivers hand on and `explain/1` puts in words.
  """

  alias BB.Bus.GPIO

  @enforce_keys [:gpio, :handle, :spec]
  defstruct [:gpio, :handle, :spec]

  @type t :: %__MODULE__{gpio: module(), handle: term(), spec: spec() | [spec()]}

  @typedoc "A chip and a line, a label, a chip and a label, or an index over all lines; the first is the clearest."
  @type spec :: {String.t(), non_neg_integer() | String.t()} | String.t() | non_neg_integer()

  @typedoc """
  Why a line does not work:

  - `:line_not_found`: there is no such line;
  - `:no_rights`: its chip may not be opened;
  - `:line_busy`: another program has it;
  - `:line_lost`: it was taken over, or its chip has gone;
  - `:noise`: its level changes all the time;
  - `:line`: another error, as the bus's module gave it.
  """
  @type reason ::
          {:line_not_found, spec() | [spec()]}
          | {:no_rights, spec() | [spec()]}
          | {:line_busy, spec() | [spec()]}
          | {:line_lost, spec() | [spec()]}
          | {:noise, spec() | [spec()]}
          | {:line, spec() | [spec()], error :: term()}

  # More edges in this time are no contact that bounces.
  @quiet_ms 20
  @most_edges 10

  @doc "The option `:gpio` of every driver on lines, for its schema."
  @spec options() :: keyword()
  def options do
    [
      gpio: [
        type: {:or, [:module, nil]},
        default: nil,
        doc: "The bus's module; when `nil`, that of `BB.Bus.GPIO.module/1`."
      ]
    ]
  end

  @doc "An option that is a line, for a driver's schema."
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
         "expected a line, as {\"gpiochip0\", 17}, \"GPIO17\" or {\"gpiochip0\", \"GPIO17\"}, got: #{inspect(other)}"}
    end
  end

  @doc "Opens a line, or a list of them as a group, also where a process that has died had it; options as in `BB.Bus.GPIO`."
  @spec open(module() | nil, spec() | [spec()], :input | :output, keyword()) ::
          {:ok, t()} | {:error, reason()}
  def open(gpio, spec, direction, opts) do
    gpio = GPIO.module(gpio)

    case gpio.open(spec, direction, [on_busy: :take_over] ++ opts) do
      {:ok, handle} -> {:ok, %__MODULE__{gpio: gpio, handle: handle, spec: spec}}
      {:error, error} -> {:error, reason(error, spec)}
    end
  end

  @doc "Gives it back. Edges that were told are still in the mailbox, and are taken out."
  @spec close(t()) :: :ok
  def close(line) do
    :ok = line.gpio.close(line.handle)
    forget(line)
  end

  @doc "Its level; of a group a bit each, the first line's lowest."
  @spec read(t()) :: {:ok, non_neg_integer()} | {:error, reason()}
  def read(line), do: raised(line, fn -> {:ok, line.gpio.read(line.handle)} end)

  @doc "Sets the level of an output."
  @spec write(t(), 0 | 1) :: :ok | {:error, reason()}
  def write(line, level), do: raised(line, fn -> line.gpio.write(line.handle, level) end)

  @doc "Has the calling process told of edges, `{:circuits_gpio, spec, timestamp_ns, level}`, or (`:none`) no more; those that were told are forgotten."
  @spec listen(t(), :both | :rising | :falling | :none) :: :ok | {:error, reason()}
  def listen(line, trigger) do
    with :ok <- line |> told(line.gpio.set_interrupts(line.handle, trigger)), do: forget(line)
  end

  @doc "Has the calling process told of edges of a group: `{:circuits_gpio, %{ref: tag, timestamp: ns, value: v, previous_value: v}}`."
  @spec subscribe(t(), tag :: term()) :: :ok | {:error, reason()}
  def subscribe(line, tag) do
    with {:ok, ^tag} <- told(line, line.gpio.subscribe(line.handle, tag: tag)), do: :ok
  end

  @doc """
  Makes sure that nobody but who should is heard on an input: that there are not more than #{@most_edges} edges in #{@quiet_ms} ms.

  It waits that long, and listens to `:both` edges from then on.
  """
  @spec check_quiet(t()) :: :ok | {:error, reason()}
  def check_quiet(line) do
    with :ok <- listen(line, :both) do
      Process.sleep(@quiet_ms)
      with {:ok, _level} <- read(line), do: judge(line, edges(line.spec, 0))
    end
  end

  defp judge(line, edges) when edges > @most_edges, do: {:error, {:noise, line.spec}}
  defp judge(_line, _edges), do: :ok

  @doc "Opens one with `open`, and does `prepare` with it: what that returns. When it is an error, the line is given back."
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
  A reason in a sentence that says what to look at.

      iex> BB.Bus.GPIO.Line.explain({:line_busy, {"gpiochip0", 17}})
      "line 17 of gpiochip0 is in use: find the other program or device tree entry that has it"
      iex> BB.Bus.GPIO.Line.explain({:noise, "BUMPER"})
      "line BUMPER changes all the time: check its wire, its ground and its pull resistor"
  """
  @spec explain(reason()) :: String.t()
  def explain({:line_not_found, spec}),
    do: "there is no #{name(spec)}: check its name, and that its chip is enabled"

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
  A line's name in a sentence.

      iex> BB.Bus.GPIO.Line.name([{"gpiochip0", 5}, {"gpiochip0", "ENC_B"}])
      "line 5 of gpiochip0 and line ENC_B of gpiochip0"
  """
  @spec name(spec() | [spec()]) :: String.t()
  def name(specs) when is_list(specs), do: Enum.map_join(specs, " and ", &name/1)
  def name({chip, at}), do: "line #{at} of #{chip}"
  def name(at), do: "line #{at}"

  # All chips of a machine belong to one group.
  defp chip([spec | _]), do: chip(spec)
  defp chip({"gpiochip" <> _ = chip, _at}), do: BB.Bus.Linux.path(chip)

  defp chip(_spec),
    do: BB.Bus.Linux.path(List.first(BB.Bus.Linux.devices("gpiochip")) || "gpiochip0")

  # Those who read and write are told by exceptions.
  defp raised(line, fun) do
    fun.()
  rescue
    error in ErlangError -> {:error, reason(error.original, line.spec)}
  end

  defp told(line, {:error, error}), do: {:error, reason(error, line.spec)}
  defp told(_line, result), do: result

  defp reason(error, spec) when error in [:not_found, :einval], do: {:line_not_found, spec}
  defp reason(:eacces, spec), do: {:no_rights, spec}
  defp reason(:already_open, spec), do: {:line_busy, spec}
  defp reason(error, spec) when error in [:ebadf, :enodev], do: {:line_lost, spec}
  defp reason(error, spec), do: {:line, spec, error}

  defp forget(%{spec: spec}) do
    _ = edges(spec, 0)
    :ok
  end

  defp edges(spec, count) do
    receive do
      {:circuits_gpio, ^spec, _time_ns, _level} -> edges(spec, count + 1)
    after
      0 -> count
    end
  end
end

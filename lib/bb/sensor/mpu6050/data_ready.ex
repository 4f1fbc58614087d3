defmodule BB.Sensor.Mpu6050.DataReady do
  @moduledoc """
  The chip with its pin INT wired to a line: each edge is a sample, and the sample's time is the edge's.

  With the FIFO all samples are kept until they are read, so none is lost while the bus or this process is busy, for as long as the
  FIFO has room: #{div(1024, 14)} samples in an MPU-6050, #{div(512, 14)} in the others.
  """
  alias BB.Bus.GPIO.Line
  alias BB.Clock
  alias BB.Sensor.Mpu6050.{Chip, Registers, Stamps}

  @enforce_keys [:chip, :line, :clock, :fifo?, :stamps]
  defstruct [:chip, :line, :clock, :fifo?, :stamps, alive?: true]

  @typedoc "`alive?`: an edge was heard since somebody looked."
  @type t :: %__MODULE__{
          chip: Chip.t(),
          line: Line.t(),
          clock: Clock.t(),
          fifo?: boolean(),
          stamps: Stamps.t(),
          alive?: boolean()
        }

  @type reason :: Chip.reason() | Line.reason() | {:no_interrupt, Line.spec(), String.t(), byte()}

  @first_edge_ms 500
  @first_periods 5
  @looks_hz 20
  @ns_per_ms 1_000_000

  @doc "The options of a line, for the driver's schema."
  @spec options() :: keyword()
  def options do
    line =
      Line.option(
        "The GPIO line that the pin INT is wired to, such as `{\"gpiochip0\", 4}`. Then each sample of the chip is published, with the time of its edge."
      )

    [interrupt: Keyword.merge(line, required: false)] ++ Line.options()
  end

  @doc "How often to `look/1`: so that between two looks there are two samples at least."
  @spec looks_hz(sample_rate_hz :: number()) :: number()
  def looks_hz(sample_rate_hz), do: min(@looks_hz, sample_rate_hz / 2)

  @doc "Opens the line of a chip that is set up to pulse, and waits for its first edge."
  @spec open(Chip.t(), keyword(), Clock.t()) :: {:ok, t()} | {:error, reason()}
  def open(chip, opts, clock) do
    Line.open_with(
      fn -> Line.open(opts[:gpio], opts[:interrupt], :input, pull_mode: :pulldown) end,
      &start(new(chip, &1, opts[:fifo], clock))
    )
  end

  defp new(chip, line, fifo?, clock) do
    rate_hz = Registers.sample_rate_hz(chip.settings.divider, chip.settings.filter)
    stamps = Stamps.new(round(1.0e9 / rate_hz))
    %__MODULE__{chip: chip, line: line, clock: clock, fifo?: fifo?, stamps: stamps}
  end

  defp start(device) do
    with :ok <- Line.listen(device.line, :rising),
         :ok <- if(device.fifo?, do: Chip.start_fifo(device.chip), else: :ok),
         do: first_edge(device)
  end

  # By the robot's clock, which is the chip's where that is simulated.
  defp first_edge(%{clock: clock, line: %{spec: spec}} = device) do
    longest_ns = max(@first_edge_ms * @ns_per_ms, @first_periods * device.stamps.period_ns)
    over = make_ref()
    timer = Clock.send_at(clock, Clock.now_ns(clock) + longest_ns, self(), over)

    receive do
      {:circuits_gpio, ^spec, edge_ns, _level} ->
        :ok = Clock.recall(clock, timer, over)
        {:ok, heard(device, edge_ns)}

      ^over ->
        silent(device)
    end
  end

  @doc "Gives line and bus back."
  @spec close(t()) :: :ok
  def close(device) do
    :ok = Line.close(device.line)
    Chip.close(device.chip)
  end

  @doc "An edge was heard, and with it all those that wait in the mailbox."
  @spec heard(t(), integer()) :: t()
  def heard(device, edge_ns) do
    stamps = Stamps.heard(device.stamps, edge_ns, Clock.now_ns(device.clock))
    more(%{device | stamps: stamps, alive?: true})
  end

  defp more(%{line: %{spec: spec}} = device) do
    receive do
      {:circuits_gpio, ^spec, edge_ns, _level} -> heard(device, edge_ns)
    after
      0 -> device
    end
  end

  @doc "The samples whose edges were heard, each with its time. `:stop` is an error after which nobody knows any more which edge is whose."
  @spec read(t()) ::
          {:ok, [{integer(), Registers.reading()}], t()}
          | {:none, t()}
          | {:error, reason()}
          | {:stop, reason()}
  def read(%{fifo?: false} = device) do
    with {:ok, reading, new?} <- Chip.sample(device.chip) do
      {time_ns, stamps} = Stamps.last(device.stamps)
      device = %{device | stamps: stamps}
      if new?, do: {:ok, [{time_ns, reading}], device}, else: {:none, device}
    end
  end

  def read(device) do
    case Chip.fifo_count(device.chip) do
      {:ok, count} -> device.stamps |> Stamps.pair(count) |> paired(device)
      {:error, {:overflow, _bus, _address} = reason} -> {:stop, reason}
      {:error, reason} -> {:error, reason}
    end
  end

  defp paired(:noise, device), do: {:stop, {:noise, device.line.spec}}
  defp paired({:ok, [], stamps}, device), do: {:none, %{device | stamps: stamps}}
  defp paired({:ok, times, stamps}, device), do: take(%{device | stamps: stamps}, times)

  defp take(device, times) do
    with {:ok, readings} <- Chip.take(device.chip, length(times)),
         do: {:ok, Enum.zip(times, readings), device}
  end

  @doc "Makes sure that edges still come."
  @spec look(t()) :: {:none, t()} | {:error, reason()}
  def look(%{alive?: true} = device), do: {:none, %{device | alive?: false}}
  def look(device), do: silent(device)

  # What does not answer either has not lost the wire of its pin.
  defp silent(%{chip: %{device: %{bus_name: bus, address: address}} = chip} = device) do
    with {:ok, _reading, _new?} <- Chip.sample(chip),
         do: {:error, {:no_interrupt, device.line.spec, bus, address}}
  end

  @doc "Whether a reason is one that `explain/1` has words for."
  defguard is_reason(reason)
           when elem(reason, 0) in [:no_interrupt, :overflow, :noise] or
                  elem(reason, 0) in [:line_not_found, :line_busy, :line_lost, :line]

  @doc """
  A reason in a sentence that says what to look at.

      iex> BB.Sensor.Mpu6050.DataReady.explain({:no_interrupt, {"gpiochip0", 4}, "i2c-1", 0x68})
      "no edge came on line 4 of gpiochip0 from the chip at 0x68 on i2c-1: check the wire to its pin INT"
  """
  @spec explain(reason()) :: String.t()
  def explain({:no_interrupt, spec, bus, address}),
    do:
      "no edge came on #{Line.name(spec)} from the chip at #{Chip.place(bus, address)}: check the wire to its pin INT"

  def explain({:overflow, bus, address}),
    do:
      "the FIFO of the chip at #{Chip.place(bus, address)} overflowed and samples were lost: lower its rate, or see what keeps the bus busy"

  def explain(reason), do: Line.explain(reason)
end

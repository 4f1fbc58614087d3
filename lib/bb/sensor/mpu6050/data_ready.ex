defmodule BB.Sensor.Mpu6050.DataReady do
  @moduledoc """
  The MPU-6050 with its pin INT wired to a line: each edge is a sample, at the time of the edge.

  `BB.Sensor.Mpu6050` uses it with the option `interrupt:`.

  With the FIFO, samples wait in the chip until they are read. So none is lost while the bus or
  the sensor's process is busy, as long as the FIFO has room: for #{div(1024, 14)} samples in an
  MPU-6050, for
  #{div(512, 14)} in the others.
  """
  @moduledoc no_example: "internal: BB.Sensor.Mpu6050 is its interface"

  alias BB.Bus.GPIO.Line
  alias BB.Clock
  alias BB.Sensor.Mpu6050.{Chip, Registers, Stamps}

  @enforce_keys [:chip, :line, :clock, :fifo?, :stamps]
  defstruct [:chip, :line, :clock, :fifo?, :stamps, edge_seen?: true]

  @typedoc "A chip with its line. `:edge_seen?` is whether an edge came since the last check."
  @type t :: %__MODULE__{
          chip: Chip.t(),
          line: Line.t(),
          clock: Clock.t(),
          fifo?: boolean(),
          stamps: Stamps.t(),
          edge_seen?: boolean()
        }

  @typedoc "Why it fails: a reason of the chip or of the line, or `:no_interrupt`."
  @type reason :: Chip.reason() | Line.reason() | {:no_interrupt, Line.spec(), String.t(), byte()}

  @first_edge_ms 500
  @first_periods 5
  @checks_hz 20
  @ns_per_ms 1_000_000

  @doc "Returns the options of the line, for the driver's schema."
  @spec options() :: keyword()
  def options do
    line =
      Line.option(
        "The GPIO line of the pin INT, such as `{\"gpiochip0\", 4}`. With it, each sample of " <>
          "the chip is published, with the time of its edge."
      )

    [interrupt: Keyword.merge(line, required: false)] ++ Line.options()
  end

  @doc "Returns how often to call `check_edges/1`, so that at least two samples come in between."
  @spec checks_hz(sample_rate_hz :: number()) :: number()
  def checks_hz(sample_rate_hz), do: min(@checks_hz, sample_rate_hz / 2)

  @doc "Opens the line of a chip that signals its samples, and waits for the first edge."
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
         do: await_first_edge(device)
  end

  # The robot's clock is also the clock of a simulated chip.
  defp await_first_edge(%{clock: clock, line: %{spec: spec}} = device) do
    longest_ns = max(@first_edge_ms * @ns_per_ms, @first_periods * device.stamps.period_ns)
    timeout = make_ref()
    timer = Clock.send_at(clock, Clock.now_ns(clock) + longest_ns, self(), timeout)

    receive do
      {:circuits_gpio, ^spec, edge_ns, _level} ->
        :ok = Clock.recall(clock, timer, timeout)
        {:ok, add_edge(device, edge_ns)}

      ^timeout ->
        no_interrupt(device)
    end
  end

  @doc "Closes the line and the bus."
  @spec close(t()) :: :ok
  def close(device) do
    :ok = Line.close(device.line)
    Chip.close(device.chip)
  end

  @doc "Adds an edge, and all edges that wait in the mailbox."
  @spec add_edge(t(), integer()) :: t()
  def add_edge(device, edge_ns) do
    stamps = Stamps.add_edge(device.stamps, edge_ns, Clock.now_ns(device.clock))
    add_waiting_edges(%{device | stamps: stamps, edge_seen?: true})
  end

  defp add_waiting_edges(%{line: %{spec: spec}} = device) do
    receive do
      {:circuits_gpio, ^spec, edge_ns, _level} -> add_edge(device, edge_ns)
    after
      0 -> device
    end
  end

  @doc """
  Reads the samples of the edges that came, each with its time.

  `:stop` is an error after which edges no longer belong to known samples.
  """
  @spec read(t()) ::
          {:ok, [{integer(), Registers.reading()}], t()}
          | {:none, t()}
          | {:error, reason()}
          | {:stop, reason()}
  def read(%{fifo?: false} = device) do
    with {:ok, reading, new?} <- Chip.sample(device.chip) do
      {time_ns, stamps} = Stamps.take_last(device.stamps)
      device = %{device | stamps: stamps}
      if new?, do: {:ok, [{time_ns, reading}], device}, else: {:none, device}
    end
  end

  def read(device) do
    case Chip.fifo_count(device.chip) do
      {:ok, count} -> device.stamps |> Stamps.take(count) |> take_samples(device)
      {:error, {:overflow, _bus, _address} = reason} -> {:stop, reason}
      {:error, reason} -> {:error, reason}
    end
  end

  defp take_samples(:noise, device), do: {:stop, {:noise, device.line.spec}}
  defp take_samples({:ok, [], stamps}, device), do: {:none, %{device | stamps: stamps}}

  defp take_samples({:ok, times, stamps}, device) do
    with {:ok, readings} <- Chip.take(device.chip, length(times)),
         do: {:ok, Enum.zip(times, readings), %{device | stamps: stamps}}
  end

  @doc "Checks that an edge came since the last check."
  @spec check_edges(t()) :: {:none, t()} | {:error, reason()}
  def check_edges(%{edge_seen?: true} = device), do: {:none, %{device | edge_seen?: false}}
  def check_edges(device), do: no_interrupt(device)

  # A chip that does not answer has another fault than the wire of its pin.
  defp no_interrupt(%{chip: %{device: %{bus_name: bus, address: address}} = chip} = device) do
    with {:ok, _reading, _new?} <- Chip.sample(chip),
         do: {:error, {:no_interrupt, device.line.spec, bus, address}}
  end

  @doc "Returns whether `explain/1` takes a reason."
  defguard is_reason(reason)
           when elem(reason, 0) in [:no_interrupt, :overflow, :noise] or
                  elem(reason, 0) in [:line_not_found, :line_busy, :line_lost, :line]

  @doc """
  Formats a reason as a sentence that says what to check.

      iex> alias BB.Sensor.Mpu6050.DataReady
      iex> DataReady.explain({:no_interrupt, {"gpiochip0", 4}, "i2c-1", 0x68})
      "no edge on line 4 of gpiochip0 from the chip at 0x68 on i2c-1: check the wire of pin INT"
  """
  @spec explain(reason()) :: String.t()
  def explain({:no_interrupt, spec, bus, address}),
    do:
      "no edge on #{Line.name(spec)} from the chip at #{Chip.place(bus, address)}: check the " <>
        "wire of pin INT"

  def explain({:overflow, bus, address}),
    do:
      "the FIFO of the chip at #{Chip.place(bus, address)} overflowed and samples were lost: " <>
        "lower its rate, or find what keeps the bus busy"

  def explain(reason), do: Line.explain(reason)
end

defmodule BB.Sensor.Polled do
  @moduledoc """
  A driver that asks its device at a rate: it opens, measures and publishes, and all else is done for it.

      defmodule MyRobot.Thermometer do
        @schema BB.Bus.I2C.Device.options(address: 0x48..0x4F, default: 0x48) ++
                  BB.Sensor.Polled.options(rate: {1, 10}, default: 4)

        use BB.Sensor.Polled, options_schema: @schema

        alias BB.Bus.I2C.Device

        @impl BB.Sensor.Polled
        def open(opts), do: Device.open(opts)

        @impl BB.Sensor.Polled
        def measure(device, _now_ns) do
          with {:ok, <<eighths::signed-11, _::5>>} <- Device.read(device, 0, 2), do: {:ok, eighths / 8, device}
        end

        @impl BB.Sensor.Polled
        def publish(celsius, sensor),
          do: BB.Sensor.publish(sensor.bb, BB.Message.new!(Temperature, sensor.frame_id, celsius: celsius))

        @impl BB.Sensor.Polled
        def close(device), do: Device.close(device)

        @impl BB.Sensor
        def explain(reason), do: Device.explain(reason)
      end

  Such a module is a `BB.Sensor`, whose callbacks for messages, new options and the end are these; it may override them. Its options
  are those of `options/1` and its own.

  ## What goes wrong

  A reading is published when it was made, or not at all. After three failed readings in a row the sensor stops with the last one's reason, and
  is started again as its robot's supervision says. What answers after a failed reading may be a device that was plugged in anew:
  `c:check/1` is called before the next one. It is called each half second too, since bits that flip on the wires make readings that look like any other, and
  show only in what is known. A reason of the kind `:restarted` (`t:BB.Bus.I2C.Device.reason/0`) stops the sensor at once, so
  that the device is set up again, and so does `{:stop, reason}` from `c:measure/2`.

  A device that should have a new reading and has none (`{:none, reason, device}`) is not asked in vain for ever: from the fourth time in a row on it is a failed reading. (A tick that came late has
  the next one close behind it, with nothing new.)

  What keeps a device from measuring at all belongs into `c:open/1` too: a sensor that opens well and then fails goes up and down for
  as long as the fault lasts, instead of staying down with one reason.
  """

  alias BB.Loop

  @most_failures 3
  @most_idle 3
  @check_ms 500
  @check_ns @check_ms * 1_000_000

  @enforce_keys [:module, :bb, :frame_id, :device, :loop]
  defstruct [:module, :bb, :frame_id, :device, :loop, :checked_ns, failures: 0, idle: 0]

  @typedoc """
  The sensor's state: `device` is the driver's, `failures` counts those in a row, `idle` how often in a row there was nothing new, `checked_ns` is when
  it was checked last.
  """
  @type t :: %__MODULE__{
          module: module(),
          bb: BB.Sensor.bb(),
          frame_id: atom(),
          device: device(),
          loop: Loop.t(),
          checked_ns: integer() | nil,
          failures: non_neg_integer(),
          idle: non_neg_integer()
        }

  @typedoc "What the driver opened, and all that it wants to remember from one reading to the next."
  @type device :: term()

  @typedoc "Why it does not work, for the driver's `explain/1`."
  @type reason :: term()

  @typedoc "What `c:measure/2` gives."
  @type result ::
          {:ok, reading :: term(), device()}
          | {:none, device()}
          | {:none, reason(), device()}
          | {:error, reason()}
          | {:error, reason(), device()}
          | {:stop, reason()}

  @doc """
  Opens the device, makes sure that it is the right one and works, and sets it up. It may wait: it runs in the sensor's own process.
  What it has opened when it fails, it closes.
  """
  @callback open(opts :: keyword()) :: {:ok, device()} | {:error, reason()}

  @doc """
  A reading; `:none` when the device has no new one, with a reason where that must not go on; or why there is none, with the device where that
  has changed; `{:stop, reason}` for a reason after which it makes no sense to go on. `now_ns` is the time of the robot's clock.
  """
  @callback measure(device(), now_ns :: integer()) :: result()

  @doc "Publishes a reading."
  @callback publish(reading :: term(), sensor :: t()) :: :ok

  @doc "Gives the device back."
  @callback close(device()) :: term()

  @doc "Makes sure, after a failed reading and each #{@check_ms} ms, that the device still is as `c:open/1` left it. By default it is taken to be."
  @callback check(device()) :: :ok | {:error, reason()}

  @doc "How often to measure, in Hz. By default it is the option `:rate`."
  @callback pace(opts :: keyword()) :: number()

  @doc """
  The options of every such sensor, `:rate` and `:frame_id`, for a driver's schema: `rate:` the slowest and the fastest rate in Hz,
  `default:` that of who gives none.
  """
  @spec options(rate: {number(), number()}, default: number()) :: keyword()
  def options(rate: {slowest, fastest}, default: default) do
    [
      rate: [
        type: BB.Unit.option(:hertz, slowest, fastest),
        default: default,
        doc:
          "Readings a second: a number of Hz or a unit of frequency, #{slowest} Hz to #{fastest} Hz."
      ],
      frame_id: [
        type: {:or, [:atom, nil]},
        default: nil,
        doc: "The messages' frame; the sensor's name when `nil`."
      ]
    ]
  end

  @doc false
  defmacro __using__(opts) do
    quote do
      use BB.Sensor, unquote(opts)
      @behaviour BB.Sensor.Polled

      @doc false
      def rate(opts), do: opts[:rate]

      @doc false
      def init(opts), do: BB.Sensor.Polled.init(__MODULE__, opts)

      @doc false
      def handle_options(opts, sensor), do: BB.Sensor.Polled.handle_options(opts, sensor)

      @doc false
      def handle_info(message, sensor), do: BB.Sensor.Polled.handle_info(message, sensor)

      @doc false
      def terminate(_reason, sensor), do: BB.Sensor.Polled.stop(sensor)

      @doc false
      def check(_device), do: :ok

      @doc false
      def pace(opts), do: opts[:rate]

      defoverridable rate: 1,
                     pace: 1,
                     init: 1,
                     handle_options: 2,
                     handle_info: 2,
                     terminate: 2,
                     check: 1
    end
  end

  @doc "What `init/1` of such a sensor is."
  @spec init(module(), keyword()) :: {:ok, t()} | {:stop, reason()}
  def init(module, opts) do
    case module.open(opts) do
      {:ok, device} -> {:ok, new(module, device, opts)}
      {:error, reason} -> {:stop, reason}
    end
  end

  @doc "What its `handle_options/2` is: the device is closed, and opened with the new options."
  @spec handle_options(keyword(), t()) :: {:ok, t()} | {:stop, reason()}
  def handle_options(opts, sensor) do
    stop(sensor)
    init(sensor.module, opts)
  end

  @doc "What its `handle_info/2` is: a reading at each tick."
  @spec handle_info(term(), t()) :: {:noreply, t()} | {:stop, {:shutdown, reason()}, t()}
  def handle_info(:tick, sensor) do
    {_dt, _skipped, loop} = Loop.tick(sensor.loop)
    {result, sensor} = measure(%{sensor | loop: loop})
    outcome(result, sensor)
  end

  def handle_info(_late, sensor), do: {:noreply, sensor}

  @doc """
  What follows from what `c:measure/2` gave, for a driver that also measures when its device tells it to: a return value for `handle_info/2`.
  """
  @spec outcome(result(), t()) :: {:noreply, t()} | {:stop, {:shutdown, reason()}, t()}
  def outcome({:ok, reading, device}, sensor), do: measured(reading, succeeded(sensor, device))
  def outcome({:none, device}, sensor), do: {:noreply, succeeded(sensor, device)}
  def outcome({:none, reason, device}, sensor), do: idle(reason, %{sensor | device: device})
  def outcome({:error, reason}, sensor), do: failed(reason, sensor)
  def outcome({:error, reason, device}, sensor), do: failed(reason, %{sensor | device: device})
  def outcome({:stop, reason}, sensor), do: {:stop, {:shutdown, reason}, sensor}

  @doc "What its `terminate/2` does: no tick comes any more, and the device is given back."
  @spec stop(t()) :: term()
  def stop(sensor) do
    _ = Loop.cancel(sensor.loop)
    sensor.module.close(sensor.device)
  end

  defp new(module, device, opts) do
    bb = opts[:bb]

    %__MODULE__{
      module: module,
      bb: bb,
      frame_id: opts[:frame_id] || List.last(bb.path),
      device: device,
      loop: bb |> Loop.new(clock: {:rate, module.pace(opts)}) |> Loop.arm()
    }
  end

  defp measure(sensor) do
    if check_due?(sensor),
      do: {check_and_ask(sensor), %{sensor | checked_ns: sensor.loop.last_ns}},
      else: {ask(sensor), sensor}
  end

  defp check_due?(%{checked_ns: nil}), do: true
  defp check_due?(%{failures: failures}) when failures > 0, do: true
  defp check_due?(sensor), do: sensor.loop.last_ns - sensor.checked_ns >= @check_ns

  defp check_and_ask(sensor),
    do: with(:ok <- sensor.module.check(sensor.device), do: ask(sensor))

  defp ask(sensor), do: sensor.module.measure(sensor.device, sensor.loop.last_ns)

  defp measured(reading, sensor) do
    sensor.module.publish(reading, sensor)
    {:noreply, sensor}
  end

  defp succeeded(sensor, device), do: %{sensor | device: device, failures: 0, idle: 0}

  defp idle(_reason, %{idle: idle} = sensor) when idle < @most_idle,
    do: {:noreply, %{sensor | idle: idle + 1, failures: 0}}

  defp idle(reason, sensor), do: failed(reason, sensor)

  defp failed(reason, sensor) do
    if sensor.failures + 1 >= @most_failures or restarted?(reason),
      do: {:stop, {:shutdown, reason}, sensor},
      else: {:noreply, %{sensor | failures: sensor.failures + 1}}
  end

  defp restarted?(reason), do: is_tuple(reason) and elem(reason, 0) == :restarted
end

defmodule BB.Sensor.Polled do
  @moduledoc """
  The behaviour of a driver whose device is polled at a rate. The driver opens its device,
  measures and publishes; this module does the rest.

  Use it for a device that has to be asked for each reading. A driver whose device reports by
  itself implements `BB.Sensor`.

      defmodule MyRobot.Thermometer do
        @schema BB.Bus.I2C.Device.options(address: 0x48..0x4F, default: 0x48) ++
                  BB.Sensor.Polled.options(rate: {1, 10}, default: 4)

        use BB.Sensor.Polled, options_schema: @schema

        alias BB.Bus.I2C.Device

        @impl BB.Sensor.Polled
        def open(opts), do: Device.open(opts)

        @impl BB.Sensor.Polled
        def measure(device, _now_ns) do
          with {:ok, <<eighths::signed-11, _::5>>} <- Device.read(device, 0, 2),
               do: {:ok, eighths / 8, device}
        end

        @impl BB.Sensor.Polled
        def publish(celsius, sensor) do
          message = BB.Message.new!(Temperature, sensor.frame_id, celsius: celsius)
          BB.Sensor.publish(sensor.bb, message)
        end

        @impl BB.Sensor.Polled
        def close(device), do: Device.close(device)

        @impl BB.Sensor
        def explain(reason), do: Device.explain(reason)
      end

  Such a module is a `BB.Sensor`. This module defines its `init/1`, `handle_options/2`,
  `handle_info/2`, `terminate/2` and `rate/1`, and the module may override them. Its options are
  those of `options/1` and its own.

  ## Failed readings

  A reading is published when it is made, or not at all. After three failed readings in a row the
  sensor stops with the reason of the last one, and is restarted by its keeper.

  After a failed reading the device that answers may be another one, plugged in meanwhile. So
  `c:check/1` is called before the next reading. It is also called every half second, since bits
  that flip on the wires make readings that look like any other: only a register whose value is
  known reveals them.

  A reason of the kind `:restarted` (`t:BB.Bus.I2C.Device.reason/0`) stops the sensor at once, so
  that the device is set up again. So does `{:stop, reason}` from `c:measure/2`.

  A device that should have a new reading may have none (`{:none, reason, device}`). From the
  fourth time in a row on, that counts as a failed reading. Three are allowed because a late tick
  is followed closely by the next one, for which the device has nothing new.

  Check in `c:open/1` whatever keeps the device from measuring at all. A sensor that opens well
  and then fails goes up and down as long as the fault lasts, where it should stay down with one
  reason.
  """

  alias BB.Loop

  @most_failures 3
  @most_idle 3
  @check_ms 500
  @check_ns @check_ms * 1_000_000

  @enforce_keys [:module, :bb, :frame_id, :device, :loop]
  defstruct [:module, :bb, :frame_id, :device, :loop, :checked_ns, failures: 0, idle: 0]

  @typedoc """
  The sensor's state: `device` belongs to the driver, `failures` counts the failed readings in a
  row, `idle` the ticks in a row without a new reading, and `checked_ns` is the time of the last
  check.
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

  @typedoc "The driver's state: the open device, and whatever the next reading needs."
  @type device :: term()

  @typedoc "The reason of a failure, which the driver's `explain/1` formats."
  @type reason :: term()

  @typedoc "The result of `c:measure/2`."
  @type result ::
          {:ok, reading :: term(), device()}
          | {:none, device()}
          | {:none, reason(), device()}
          | {:error, reason()}
          | {:error, reason(), device()}
          | {:stop, reason()}

  @doc """
  Opens the device, checks that it is the right one and works, and sets it up.

  It runs in the sensor's own process and may wait. When it fails it closes what it has opened.
  """
  @callback open(opts :: keyword()) :: {:ok, device()} | {:error, reason()}

  @doc """
  Takes a reading. `now_ns` is the time of the robot's clock.

  Returns

    * `{:ok, reading, device}`
    * `{:none, device}` when the device has no new reading
    * `{:none, reason, device}` when it should have one; see "Failed readings" above
    * `{:error, reason}` or `{:error, reason, device}` when the reading failed
    * `{:stop, reason}` when the sensor cannot continue
  """
  @callback measure(device(), now_ns :: integer()) :: result()

  @doc "Publishes a reading."
  @callback publish(reading :: term(), sensor :: t()) :: :ok

  @doc "Closes the device."
  @callback close(device()) :: term()

  @doc """
  Checks that the device still is as `c:open/1` left it.

  It is called after a failed reading and every #{@check_ms} ms. By default it returns `:ok`.
  """
  @callback check(device()) :: :ok | {:error, reason()}

  @doc """
  Returns how often to call `c:measure/2`, in Hz. By default it is the option `:rate`.

  It differs from `c:BB.Sensor.rate/1` when a reading is not always published.
  """
  @callback poll_rate(opts :: keyword()) :: number()

  @doc "Returns how often to call `c:measure/2`, in Hz."
  @doc deprecated: "Use poll_rate/1 instead"
  @callback pace(opts :: keyword()) :: number()

  @optional_callbacks pace: 1

  @doc """
  Returns the options of a polled sensor, `:rate` and `:frame_id`, for a driver's schema.

  `rate:` is the slowest and the fastest rate in Hz, `default:` the rate of a sensor that sets
  none.

      iex> Keyword.keys(BB.Sensor.Polled.options(rate: {1, 10}, default: 4))
      [:rate, :frame_id]
  """
  @spec options(rate: {number(), number()}, default: number()) :: keyword()
  def options(rate: {slowest, fastest}, default: default) do
    [
      rate: [
        type: BB.Unit.option(:hertz, slowest, fastest),
        default: default,
        doc:
          "Readings a second: a number of Hz or a unit of frequency, " <>
            "#{slowest} Hz to #{fastest} Hz."
      ],
      frame_id: [
        type: {:or, [:atom, nil]},
        default: nil,
        doc: "The frame of the messages; `nil` is the sensor's name."
      ]
    ]
  end

  @doc false
  defmacro __using__(opts) do
    quote do
      use BB.Sensor, unquote(opts)
      @behaviour BB.Sensor.Polled
      @before_compile BB.Sensor.Polled

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

      defoverridable rate: 1,
                     init: 1,
                     handle_options: 2,
                     handle_info: 2,
                     terminate: 2,
                     check: 1
    end
  end

  # A driver may still define pace/1, the former name of poll_rate/1.
  @doc false
  defmacro __before_compile__(env) do
    cond do
      Module.defines?(env.module, {:poll_rate, 1}) ->
        nil

      Module.defines?(env.module, {:pace, 1}) ->
        IO.warn("pace/1 is deprecated; rename it to poll_rate/1", Macro.Env.stacktrace(env))
        poll_rate_code(quote(do: pace(opts)))

      true ->
        poll_rate_code(quote(do: opts[:rate]))
    end
  end

  defp poll_rate_code(rate) do
    quote do
      @doc false
      def poll_rate(opts), do: unquote(rate)
    end
  end

  @doc "Opens the device: the `init/1` of a polled sensor."
  @spec init(module(), keyword()) :: {:ok, t()} | {:stop, reason()}
  def init(module, opts) do
    case module.open(opts) do
      {:ok, device} -> {:ok, new(module, device, opts)}
      {:error, reason} -> {:stop, reason}
    end
  end

  @doc """
  Closes the device and opens it with new options: the `handle_options/2` of a polled sensor.
  """
  @spec handle_options(keyword(), t()) :: {:ok, t()} | {:stop, reason()}
  def handle_options(opts, sensor) do
    stop(sensor)
    init(sensor.module, opts)
  end

  @doc "Takes a reading at each tick: the `handle_info/2` of a polled sensor."
  @spec handle_info(term(), t()) :: {:noreply, t()} | {:stop, {:shutdown, reason()}, t()}
  def handle_info(:tick, sensor) do
    {_dt, _skipped, loop} = Loop.tick(sensor.loop)
    {result, sensor} = measure(%{sensor | loop: loop})
    outcome(result, sensor)
  end

  def handle_info(_late, sensor), do: {:noreply, sensor}

  @doc """
  Handles a result of `c:measure/2`, and returns the return value of `handle_info/2`.

  For a driver that also measures when its device interrupts.
  """
  @spec outcome(result(), t()) :: {:noreply, t()} | {:stop, {:shutdown, reason()}, t()}
  def outcome({:ok, reading, device}, sensor), do: publish(reading, reset(sensor, device))
  def outcome({:none, device}, sensor), do: {:noreply, reset(sensor, device)}
  def outcome({:none, reason, device}, sensor), do: count_idle(reason, %{sensor | device: device})
  def outcome({:error, reason}, sensor), do: count_failure(reason, sensor)

  def outcome({:error, reason, device}, sensor),
    do: count_failure(reason, %{sensor | device: device})

  def outcome({:stop, reason}, sensor), do: {:stop, {:shutdown, reason}, sensor}

  @doc "Stops the ticks and closes the device: the `terminate/2` of a polled sensor."
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
      loop: bb |> Loop.new(clock: {:rate, module.poll_rate(opts)}) |> Loop.arm()
    }
  end

  defp measure(sensor) do
    if check_due?(sensor),
      do: {check_and_measure(sensor), %{sensor | checked_ns: sensor.loop.last_ns}},
      else: {take_reading(sensor), sensor}
  end

  defp check_due?(%{checked_ns: nil}), do: true
  defp check_due?(%{failures: failures}) when failures > 0, do: true
  defp check_due?(sensor), do: sensor.loop.last_ns - sensor.checked_ns >= @check_ns

  defp check_and_measure(sensor),
    do: with(:ok <- sensor.module.check(sensor.device), do: take_reading(sensor))

  defp take_reading(sensor), do: sensor.module.measure(sensor.device, sensor.loop.last_ns)

  defp publish(reading, sensor) do
    sensor.module.publish(reading, sensor)
    {:noreply, sensor}
  end

  defp reset(sensor, device), do: %{sensor | device: device, failures: 0, idle: 0}

  defp count_idle(_reason, %{idle: idle} = sensor) when idle < @most_idle,
    do: {:noreply, %{sensor | idle: idle + 1, failures: 0}}

  defp count_idle(reason, sensor), do: count_failure(reason, sensor)

  defp count_failure(reason, sensor) do
    if sensor.failures + 1 >= @most_failures or restarted?(reason),
      do: {:stop, {:shutdown, reason}, sensor},
      else: {:noreply, %{sensor | failures: sensor.failures + 1}}
  end

  defp restarted?(reason), do: is_tuple(reason) and elem(reason, 0) == :restarted
end

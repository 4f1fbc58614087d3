defmodule BB.Sensor.ConformanceTest do
  use ExUnit.Case, async: true

  alias BB.Sensor.Conformance
  alias BB.Sensor.Conformance.{Failure, Setting}

  @moduletag :capture_log

  # A chip that counts how often it was read.
  defmodule Chip do
    @behaviour BB.Bus.Sim.Device

    @impl true
    def init(opts, _now_ns), do: {:ok, %{id: opts[:id] || 7, count: 0, pointer: 0}}

    @impl true
    def write(<<pointer>>, _now_ns, chip), do: {:ok, %{chip | pointer: pointer}}

    @impl true
    def read(1, _now_ns, %{pointer: 0} = chip), do: {:ok, <<chip.id>>, chip}

    def read(1, _now_ns, chip),
      do: {:ok, <<rem(chip.count, 2)>>, %{chip | count: chip.count + 1}}
  end

  # A driver that is right unless its options name a fault, its sin.
  defmodule Driver do
    use BB.Sensor,
      options_schema: [
        bus: [type: :string, required: true],
        address: [type: :integer, default: 0x10],
        rate: [type: :integer, default: 50],
        sin: [type: {:or, [:atom, nil]}, default: nil]
      ]

    alias BB.Message
    alias BB.Message.Sensor.Contact

    @impl BB.Sensor
    def rate(opts), do: unless(opts[:sin] == :declares_nothing, do: opts[:rate])

    @impl BB.Sensor
    def explain({:no_answer, address}), do: "no answer at #{address}: check wiring and power"
    def explain({:other_chip, id}), do: "the chip calls itself #{id}: check the part"

    @impl BB.Sensor
    def init(opts) do
      i2c = BB.Bus.I2C.module(nil)

      with {:ok, bus} <- i2c.open(opts[:bus], timeout: 20),
           sensor = %{opts: opts, i2c: i2c, bus: bus, last: 0},
           :ok <- identify(sensor) do
        {:ok, Map.put(sensor, :loop, loop(opts))}
      else
        {:error, reason} -> {:stop, reason}
      end
    end

    defp identify(sensor) do
      case ask(sensor, 0) do
        {:ok, <<id>>} when id != 7 ->
          if sin?(sensor, :takes_any_chip), do: :ok, else: {:error, {:other_chip, id}}

        {:ok, _id} ->
          :ok

        error ->
          error
      end
    end

    defp loop(opts) do
      slower = if opts[:sin] == :drifts, do: 0.99, else: 1
      opts[:bb] |> BB.Loop.new(clock: {:rate, opts[:rate] * slower}) |> BB.Loop.arm()
    end

    @impl BB.Sensor
    def handle_info(:tick, sensor) do
      {_dt, _skipped, loop} = BB.Loop.tick(sensor.loop)
      sensor = %{sensor | loop: loop}

      case ask(sensor, 1) do
        {:ok, <<value>>} -> {:noreply, publish(%{sensor | last: value})}
        {:error, reason} -> failed(reason, sensor)
      end
    end

    defp failed(reason, sensor) do
      cond do
        sin?(sensor, :repeats_itself) -> {:noreply, publish(sensor)}
        sin?(sensor, :says_nothing) -> {:noreply, sensor}
        sin?(sensor, :repeats_itself_once) -> {:stop, {:shutdown, reason}, publish(sensor)}
        true -> {:stop, {:shutdown, reason}, sensor}
      end
    end

    defp publish(sensor) do
      message = Message.new!(Contact, :chip, pressed: sensor.last == 1)
      BB.Sensor.publish(sensor.opts[:bb], message)
      sensor
    end

    @impl BB.Sensor
    def handle_options(opts, sensor) do
      if sin?(sensor, :stays_as_it_is), do: {:ok, sensor}, else: take_on(opts, sensor)
    end

    defp take_on(opts, sensor) do
      BB.Loop.cancel(sensor.loop)
      {:ok, %{sensor | opts: opts, loop: loop(opts)}}
    end

    @impl BB.Sensor
    def terminate(_reason, sensor) do
      if sin?(sensor, :never_stops), do: Process.sleep(:infinity)
      sensor.i2c.close(sensor.bus)
    end

    # Also after a restart: the scheduler decides which of its exits is read first.
    defp no_answer(sensor) do
      if sin?(sensor, :has_no_words), do: {:e, 42}, else: {:no_answer, sensor.opts[:address]}
    end

    defp sin?(sensor, sin), do: sensor.opts[:sin] == sin

    defp ask(sensor, register) do
      with {:error, _} <-
             sensor.i2c.write_read(sensor.bus, sensor.opts[:address], <<register>>, 1),
           do: {:error, no_answer(sensor)}
    end
  end

  use Conformance,
    driver: {Driver, rate: 50},
    device: {Chip, []},
    other_device: {Chip, id: 8},
    new_options: [rate: 20]

  # A driver of a line that publishes each edge.
  defmodule Edges do
    use BB.Sensor, options_schema: [line: [type: :any, required: true]]

    @impl BB.Sensor
    def explain({:cannot_be_opened, line, reason}),
      do: "the line #{inspect(line)} cannot be opened: #{reason}"

    @impl BB.Sensor
    def init(opts) do
      gpio = BB.Bus.GPIO.module(nil)

      with {:ok, line} <- gpio.open(opts[:line], :input, pull_mode: :pullup, on_busy: :take_over),
           :ok <- gpio.set_interrupts(line, :both) do
        {:ok, %{bb: opts[:bb], gpio: gpio, line: line}}
      else
        {:error, reason} -> {:stop, {:cannot_be_opened, opts[:line], reason}}
      end
    end

    @impl BB.Sensor
    def handle_info({:circuits_gpio, _line, _time, level}, sensor) do
      message = BB.Message.new!(BB.Message.Sensor.Contact, :edges, pressed: level == 0)
      BB.Sensor.publish(sensor.bb, message)
      {:noreply, sensor}
    end

    @impl BB.Sensor
    def terminate(_reason, sensor), do: sensor.gpio.close(sensor.line)
  end

  defmodule OnALineTest do
    use Conformance,
      driver: {Edges, &[line: {&1.chip, 17}]},
      device: {BB.Bus.Sim.Contact, pins: [contact: 17]},
      unseen: [:unplug, :cut, :short, :storm],
      event:
        &BB.Bus.Sim.Lines.tell(
          &1.chip,
          &1.device,
          if(rem(&2, 2) == 1, do: :press, else: :release)
        )
  end

  defp sinner(sin, opts \\ []) do
    Setting.new!(
      [
        driver: {Driver, rate: 50, sin: sin},
        device: {Chip, []},
        other_device: {Chip, id: 8},
        new_options: [rate: 20],
        faults: [:nak]
      ] ++ opts
    )
  end

  describe "a driver does not pass" do
    # A sin that shows by a missing message ends by the patience.
    for {sin, check, words, opts} <-
          [
            takes_any_chip:
              {:identity, ~r/refuses to work with another chip/, patience_ms: 8_000},
            repeats_itself: {:faults, ~r/reports nak/, patience_ms: 8_000},
            repeats_itself_once: {:faults, ~r/while there was nak it published 1/},
            has_no_words: {:faults, ~r/add a clause to explain/},
            stays_as_it_is: {:options, ~r/declares 20 Hz and published 50. messages in 10 s/},
            drifts: {:rate, ~r/declares 50 Hz and published 297\d messages in 60 s/},
            declares_nothing: {:rate, ~r/declares no rate/},
            never_stops: {:stop, ~r/did not end by itself/}
          ]
          |> Enum.map(fn
            {sin, {check, words}} -> {sin, check, Macro.escape(words), []}
            {sin, {check, words, opts}} -> {sin, check, Macro.escape(words), opts}
          end) do
      test "that #{sin |> to_string() |> String.replace("_", " ")}" do
        error =
          assert_raise Failure, fn ->
            Conformance.run(unquote(check), sinner(unquote(sin), unquote(opts)))
          end

        assert error.message =~ unquote(words)
      end
    end

    test "that says nothing passes, since it is stale and its keeper explains that" do
      assert Conformance.run(:faults, sinner(:says_nothing)) == :ok
    end
  end

  test "a wrong setting raises with the given value" do
    assert_raise ArgumentError, ~r/expected device: {module, options}, got: nil/, fn ->
      Setting.new!(driver: {Driver, []})
    end

    assert_raise ArgumentError, ~r/got: :fire/, fn ->
      Setting.new!(driver: {Driver, []}, device: {Chip, []}, faults: [:fire])
    end
  end
end

defmodule BB.Sensor.Conformance do
  @moduledoc """
  The conformance tests that every driver passes. `use BB.Sensor.Conformance` adds them to a test
  module.

  Use it for a driver of yours: write a model of its chip (`BB.Bus.Sim.Device`, or
  `BB.Bus.Sim.GPIO.Device` for a device on GPIO lines) and name both.

      defmodule MyRobot.ThermometerTest do
        use BB.Sensor.Conformance,
          driver: {MyRobot.Thermometer, rate: 4},
          device: {MyRobot.SimulatedThermometer, celsius: 21.5},
          address: 0x18,
          other_device: {MyRobot.SimulatedThermometer, celsius: 21.5, manufacturer: 0x0055},
          new_options: [rate: 2]
      end

      defmodule MyRobot.BumperTest do
        use BB.Sensor.Conformance,
          driver: {MyRobot.Bumper, &[line: {&1.chip, 17}]},
          device: {BB.Bus.Sim.Contact, pins: [contact: 17]},
          unseen: [:unplug, :cut, :short, :storm],
          event: &MyRobot.BumperTest.press_or_release/2

        def press_or_release(place, n) do
          event = if rem(n, 2) == 1, do: :press, else: :release
          BB.Bus.Sim.Lines.tell(place.chip, place.device, event)
        end
      end

  The module becomes an asynchronous `ExUnit.Case`, and may hold further tests. Each test has a
  robot, whose only sensor is the driver, and a simulated bus of its own. Only the chip is
  simulated; keeper, restarts, health and pubsub are real.

  ## Tests

  The driver

    * identifies its chip and refuses another: with `other_device` in the chip's place the driver
      is down, explains why, and publishes nothing; with its own chip it is up
    * starts without its device: the driver is down and explains why, and is up when the device is
      present; on GPIO another program has its lines
    * reports each fault once, and clears it: one status and one alarm while the fault lasts,
      however often the driver is restarted; one status, and no alarm, when it is over
    * never publishes an old reading as new: no message between the beginning of a fault (of a
      line, which always has a level: its report) and its end; the first message after it was
      measured after it
    * survives unplug and replug: the same for pulled wires; the driver is up again, and publishes
    * honours `handle_options`: parameters change to `new_options`; the same process continues, at
      its new rate
    * keeps its rate: in a minute of stepped time (`BB.Clock.Stepped`) the driver publishes as
      often as its `rate/1` declares, to one in a thousand
    * releases its bus: after the robot has stopped, the bus is closed; after the driver's process
      was killed, it is opened again
    * stops in time: while the bus is stuck the driver stops by itself, before its keeper kills it

  A failure raises `BB.Sensor.Conformance.Failure` with a sentence that says what was observed.

  ## Options

    * `:driver` - `{module, options}`: the options without the place of the chip, `bus:` and
      `address:`, which are added. Options that depend on the place are `{module, fun}`, where
      `fun` takes the place, `%{bus: name, address: address}` or `%{chip: name, device: name}`,
      and returns all options.
    * `:device` - `{model, options}`: the chip, a `BB.Bus.Sim.Device`, or a
      `BB.Bus.Sim.GPIO.Device` with its `:pins`
    * `:address` - the chip's address; by default the driver's option `:address`, or its default
    * `:other_device` - `{model, options}`: a device that the driver has to refuse. Leave it out
      only for a chip without an identity
    * `:new_options` - options to change while the driver runs, each a number, a boolean, a string
      or an atom
    * `:faults` - the faults to test, out of those below; by default all
    * `:unseen` - the faults that no driver could detect on its wires, and only has to survive
    * `:event` - for a driver that publishes events and declares no rate: `fun.(place, n)`
      triggers the `n`th event, which is published as one message
    * `:wires` - a `BB.Sensor.Conformance.Wires` of your own, for a device neither on I2C nor on
      GPIO lines; `:device` is then whatever these wires take
    * `:patience_ms` - how long to wait for an expected event; by default 30 s. The driver is
      stale after a third of it

  The faults on I2C are `:unplug`, `:nak` (the chip does not acknowledge), `:timeout` (the chip
  holds the bus each time) and `:stuck` (a wire of the bus is held low). The faults on GPIO are
  `:unplug`, and for each of the lines `:cut`, `:short` (to ground) and `:storm` (noise of 1777
  edges a second).
  """

  alias BB.Sensor.Conformance.{Checks, Rig, Setting}

  defmodule Failure do
    @moduledoc """
    The exception of a conformance test that a driver fails. Its message says what was observed.
    """
    @moduledoc no_example: "an exception: BB.Sensor.Conformance.run/2 raises it"

    defexception [:message]
  end

  # The name of a test, its check, and the option that it needs.
  @checks [
    {"it identifies its chip and refuses another", :identity, :other_device},
    {"it starts without its device, says so, and is up when that is there", :absence, nil},
    {"it reports each fault once and clears it, and publishes nothing meanwhile", :faults, nil},
    {"it honours handle_options", :options, :new_options},
    {"it keeps its rate for a minute", :rate, nil},
    {"it releases its bus", :release, nil},
    {"it stops by itself with its bus stuck", :stop, nil}
  ]

  @doc false
  defmacro __using__(opts) do
    quote do
      use ExUnit.Case, async: true

      @moduletag timeout: 300_000
      @moduletag :capture_log

      defp conformance_setting, do: BB.Sensor.Conformance.Setting.new!(unquote(opts))

      unquote(
        for {name, check, needed} <- @checks, opts[needed] || !needed, do: code(name, check)
      )
    end
  end

  defp code(name, check) do
    quote do
      test unquote("conformance: " <> name) do
        BB.Sensor.Conformance.run(unquote(check), conformance_setting())
      end
    end
  end

  @doc "Runs a check. Raises `BB.Sensor.Conformance.Failure` when the driver fails it."
  @spec run(atom(), Setting.t()) :: :ok
  def run(check, setting) do
    apply(Checks, check, [setting])
  catch
    {Rig, :failed, sentence} -> reraise Failure, [message: sentence], __STACKTRACE__
  end
end

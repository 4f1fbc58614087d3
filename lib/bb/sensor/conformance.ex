defmodule BB.Sensor.Conformance do
  @moduledoc """
  The tests that every driver passes, in one line of its own test. A driver of yours can use them too: write a model of its chip
  (`BB.Bus.Sim.Device`, or `BB.Bus.Sim.GPIO.Device` for what hangs on lines) and name both.

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
          event: &BB.Bus.Sim.Lines.tell(&1.chip, &1.device, if(rem(&2, 2) == 1, do: :press, else: :release))
      end

  It makes the module an asynchronous `ExUnit.Case`; further tests may stand in it. Each test has a robot, whose only sensor is the driver, and a simulated bus of its
  own. What is real is all but the chip: keeper, restarts, health, pubsub.

  ## What is tested

  | the driver | how |
  |---|---|
  | identifies its chip and refuses another | with `other_device` in its place it is down, says so in words, and publishes nothing; with its own it is up |
  | starts without its device | it is down and says so in words, and up when the device is there; on GPIO it is another program that has its lines |
  | reports each fault once, and clears it | one status and one alarm for as long as the fault lasts, however often it is tried; one status, and no alarm, when it is over |
  | never publishes an old reading as new | not a message between a fault's beginning (on a line, which has a level all the same: its report) and its end; the first one after that was measured after it |
  | survives unplug and replug | the same for pulled wires: it is up again, and publishes |
  | honours `handle_options` | parameters change to `new_options`: the same process goes on, at its new rate |
  | keeps its rate | in a minute of stepped time (`BB.Clock.Stepped`) it publishes as often as its `rate/1` declares, to one in a thousand |
  | releases its bus | when the robot has stopped, and when its process was killed: it opens it again |
  | stops in time | with the bus stuck it ends by itself, before its keeper kills it |

  A failure is a sentence that says what was seen.

  ## Options

    * `:driver` - `{module, options}`: the options without those that say where the chip is, which are added: `bus:` and `address:`. Options that
      cannot be written down stand in `{module, fun}`, where `fun` gets the place, `%{bus: name, address: address}` or `%{chip: name, device: name}`, and returns all of them.
    * `:device` - `{model, options}`: its chip, a `BB.Bus.Sim.Device`, or a `BB.Bus.Sim.GPIO.Device` with its `:pins`
    * `:address` - where it is; that of the driver's option `:address`, or its default, when not given
    * `:other_device` - `{model, options}`: one that the driver is to refuse. Without it nothing is refused, which is right only for chips that have no identity
    * `:new_options` - options to change while it runs, each a number, a boolean, a string or an atom
    * `:faults` - which it is tried with, of those below; all when not given
    * `:unseen` - those of them that nobody could notice on its wires: it is only to survive them
    * `:event` - for a driver that publishes when something happens, and so declares no rate: `fun.(place, n)` makes it happen for the `n`th time, one
      message each
    * `:wires` - a `BB.Sensor.Conformance.Wires` of your own, for what hangs neither on I2C nor on lines; `:device` is then what that takes
    * `:patience_ms` - how long to wait for what must come; default 30 s. The
      driver counts as silent after a third of it

  Faults on I2C: `:unplug`, `:nak` (the chip does not acknowledge), `:timeout` (it holds the bus each time), `:stuck` (a wire of the bus is held low).
  On GPIO: `:unplug`, and of each of its lines `:cut`, `:short` (to ground) and `:storm` (noise of 1777 edges a second).
  """

  alias BB.Sensor.Conformance.{Checks, Setting}

  # A name, the check, and the option without which it makes no sense.
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

  @doc "Runs a check, which raises `BB.Sensor.Conformance.Failure` where the driver fails it."
  @spec run(atom(), Setting.t()) :: :ok
  def run(check, setting), do: apply(Checks, check, [setting])
end

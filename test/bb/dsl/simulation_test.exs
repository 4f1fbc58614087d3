defmodule BB.Dsl.SimulationTest do
  use ExUnit.Case, async: true

  import BB.Test.Mistake
  import BB.Test.Robot

  test "what hangs on the simulated buses is part of the robot's data" do
    robot =
      robot do
        simulation do
          i2c "i2c-1", clock_hz: 400_000 do
            device 0x68, {BB.Bus.Sim.Mpu6050, source: :motion}

            for address <- [0x40, 0x41] do
              device address, {BB.Bus.Sim.Ina219, source: [voltage: 11.1, current: 1.5]}
            end
          end

          i2c "i2c-2"

          gpio "gpiochip0", lines: 28 do
            device :bumper, {BB.Bus.Sim.Contact, pins: [contact: 17]}
          end
        end
      end

    rail = {BB.Bus.Sim.Ina219, source: [voltage: 11.1, current: 1.5]}

    assert robot.robot().simulation == %{
             i2c: [
               {"i2c-1",
                clock_hz: 400_000,
                devices: [
                  {0x68, {BB.Bus.Sim.Mpu6050, source: :motion}},
                  {0x40, rail},
                  {0x41, rail}
                ]},
               {"i2c-2", devices: []}
             ],
             gpio: [
               {"gpiochip0",
                lines: 28, devices: [bumper: {BB.Bus.Sim.Contact, pins: [contact: 17]}]}
             ]
           }
  end

  test "a robot without it simulates nothing" do
    robot = robot(do: sensors(do: []))
    assert robot.robot().simulation == %{i2c: [], gpio: []}
  end

  describe "a mistake is told while the robot compiles, with its place and its remedy:" do
    # What stands in a simulation, and what the error says.
    @mistakes [
      "an address that is none": {~s|i2c "i2c-1" do
        device 0x80, {BB.Bus.Sim.Mpu6050, source: :motion}
      end|, ["an address from 0 to 127 such as 0x68, got: 128"]},
      "a name in the place of an address": {~s|i2c "i2c-1" do
        device :imu, {BB.Bus.Sim.Mpu6050, source: :motion}
      end|, ["an address from 0 to 127", "got: :imu"]},
      "an address in the place of a name": {~s|gpio "gpiochip0" do
        device 17, {BB.Bus.Sim.Contact, pins: [contact: 17]}
      end|, ["must be an atom such as :my_device, got: 17"]},
      "an address with two devices": {~s|i2c "i2c-1" do
        device 0x68, {BB.Bus.Sim.Mpu6050, source: :motion}
        device 0x68, {BB.Bus.Sim.Mpu6050, source: :motion}
      end|, ["the simulated device at 0x68 is declared twice, first at lib/robot.ex:5"]},
      "a bus that stands there twice": {~s|i2c "i2c-1"
      i2c "i2c-1"|, ["the simulated i2c-1 is declared twice", "put both into one"]},
      "a bus without a name": {~s|i2c do
      end|, [~s(must be a string such as "i2c-1", got: nil)]},
      "a chip whose name is no text":
        {~s|gpio :gpiochip0|, [~s(such as "gpiochip0", got: :gpiochip0)]},
      "a field that a bus has not": {~s|i2c "i2c-1", hertz: 400_000|, [":hertz", ":clock_hz"]},
      "a clock that is none": {~s|i2c "i2c-1", clock_hz: 0|, ["clock_hz", "got: 0"]},
      "options outside of the braces": {~s|i2c "i2c-1" do
        device 0x68, BB.Bus.Sim.Mpu6050, source: :motion
      end|, ["a simulated device has no :source"]},
      "a module that is not there": {~s|i2c "i2c-1" do
        device 0x68, BB.Bus.Sim.Mpu6051
      end|, ["device at 0x68", "module BB.Bus.Sim.Mpu6051 does not exist"]},
      "a driver in the place of a chip": {~s|i2c "i2c-1" do
        device 0x68, {BB.Sensor.Mpu6050, bus: "i2c-1"}
      end|, ["BB.Sensor.Mpu6050 must implement the BB.Bus.Sim.Device behaviour"]},
      "a device of lines on a bus": {~s|i2c "i2c-1" do
        device 0x68, {BB.Bus.Sim.Contact, pins: [contact: 17]}
      end|, ["BB.Bus.Sim.Contact must implement the BB.Bus.Sim.Device behaviour"]},
      "options that the model refuses": {~s|i2c "i2c-1" do
        device 0x68, {BB.Bus.Sim.Mpu6050, source: :motoin}
      end|, ["device at 0x68", "BB.Bus.Sim.Mpu6050 refuses its options", "motoin"]},
      "a pin that is wired to nothing": {~s|gpio "gpiochip0" do
        device :sonar, {BB.Bus.Sim.HcSr04, pins: [trigger: 23]}
      end|, ["device :sonar", "refuses its options", "[trigger: 23]"]},
      "a line that the chip has not": {~s|gpio "gpiochip0", lines: 10 do
        device :bumper, {BB.Bus.Sim.Contact, pins: [contact: 17]}
      end|, ["device :bumper", "a line below 10"]},
      "a parameter in an option": {~s|i2c "i2c-1" do
        device 0x68, {BB.Bus.Sim.Mpu6050, source: BB.Parameter.Reference.param([:source])}
      end|, ["param([:source])", "write the value itself"]},
      "a value that cannot be compiled": {~s|i2c "i2c-1" do
        device 0x68, {BB.Bus.Sim.Mpu6050, source: self()}
      end|, ["option :source cannot be part of a compiled module"]}
    ]

    for {what, {lines, words}} <- @mistakes do
      test "#{what}" do
        error = mistake("simulation do\n#{unquote(lines)}\nend")
        assert hd(error.path) == :simulation
        assert error.line in 3..7
        for word <- unquote(words), do: assert(error.reason =~ word)
      end
    end

    test "a bus that two sections declare" do
      lines = "simulation do\ni2c \"i2c-1\"\nend\nsimulation do\ni2c \"i2c-1\"\nend"
      assert mistake(lines).reason =~ "i2c-1 is declared twice, first at lib/robot.ex:4"
    end

    test "a device outside of a bus" do
      error = mistake("simulation do\ndevice 0x68, BB.Bus.Sim.Mpu6050\nend")

      assert error.reason =~
               "device cannot stand in simulation; it belongs in a simulated I2C bus"
    end
  end
end

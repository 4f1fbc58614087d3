# A driver for a chip, and a robot with it.
#
#     mix run examples/own_driver.exs
#
# The chip is an LM75 thermometer: its two bytes are the temperature in steps of 1/8 °C. Here it
# is simulated; on a board the same driver reads the real one.

# The payload: a struct with a schema.
defmodule Temperature do
  @moduledoc "A temperature in degrees Celsius."

  defstruct [:celsius]
  use BB.Message, schema: [celsius: [type: :float, required: true]]
end

# The driver: it opens the chip, reads it at each tick, and publishes the temperature. If the chip
# does not answer, the driver stops with the reason, and the robot restarts it.
defmodule Lm75 do
  @moduledoc "The thermometer LM75 on I2C."

  use BB.Sensor,
    options_schema: [
      bus: [type: :string, required: true, doc: "The I2C bus."],
      address: [type: {:in, 0x48..0x4F}, default: 0x48],
      rate: [type: {:in, 1..10}, default: 4, doc: "Readings a second."]
    ]

  @impl BB.Sensor
  def init(opts) do
    i2c = BB.Bus.I2C.module(nil)

    with {:ok, bus} <- i2c.open(opts[:bus], timeout: 20),
         state = %{bb: opts[:bb], i2c: i2c, bus: bus, address: opts[:address]},
         {:ok, _celsius} <- read(state) do
      loop = BB.Loop.new(opts[:bb], clock: {:rate, opts[:rate]}) |> BB.Loop.arm()
      {:ok, Map.put(state, :loop, loop)}
    else
      {:error, reason} -> {:stop, reason}
    end
  end

  @impl BB.Sensor
  def handle_info(:tick, state) do
    {_dt, _skipped, loop} = BB.Loop.tick(state.loop)

    case read(state) do
      {:ok, celsius} ->
        {:ok, message} = Temperature.new(List.last(state.bb.path), celsius: celsius)
        BB.Sensor.publish(state.bb, message)
        {:noreply, %{state | loop: loop}}

      {:error, reason} ->
        {:stop, {:shutdown, reason}, state}
    end
  end

  @impl BB.Sensor
  def terminate(_reason, state), do: state.i2c.close(state.bus)

  # Decoding is a pure function, so that a test can check it with the numbers of the datasheet.
  def decode(<<eighths::signed-11, _::5>>), do: eighths / 8

  defp read(state) do
    with {:ok, bytes} <- state.i2c.write_read(state.bus, state.address, <<0>>, 2),
         do: {:ok, decode(bytes)}
  end
end

# The simulated chip, at 21.5 °C.
defmodule SimulatedLm75 do
  @moduledoc "An LM75 on a simulated bus."

  @behaviour BB.Bus.Sim.Device

  @impl BB.Bus.Sim.Device
  def init(opts, _now_ns), do: {:ok, opts[:celsius]}

  @impl BB.Bus.Sim.Device
  def write(_pointer, _now_ns, celsius), do: {:ok, celsius}

  @impl BB.Bus.Sim.Device
  def read(2, _now_ns, celsius), do: {:ok, <<round(celsius * 8)::signed-11, 0::5>>, celsius}
end

# The robot.
defmodule Greenhouse do
  @moduledoc "A robot with one thermometer."

  use BB

  topology do
    link :bed do
      sensor :soil, {Lm75, bus: "i2c-1", rate: 10}, max_silence: ~u(500 millisecond)
    end
  end
end

{:ok, _} =
  BB.Bus.Sim.start_link(buses: %{"i2c-1" => [devices: %{0x48 => {SimulatedLm75, celsius: 21.5}}]})

{:ok, _} = Greenhouse.start_link()
{:ok, _} = BB.subscribe(Greenhouse, [:sensor, :bed, :soil])
{:ok, _} = BB.subscribe(Greenhouse, [:sensor_status, :bed, :soil])

defmodule Listener do
  @moduledoc "Prints the messages of the sensor."

  alias BB.Message.Sensor.Status

  def readings(0), do: :ok

  def readings(count) do
    receive do
      {:bb, [:sensor, :bed, :soil], %{payload: %Temperature{celsius: celsius}}} ->
        IO.puts("soil: #{celsius} °C")
        readings(count - 1)
    end
  end

  def state(wanted) do
    receive do
      {:bb, [:sensor_status | _], %{payload: %Status{state: ^wanted, reason: reason}}} ->
        IO.puts("soil is #{wanted}" <> if(reason, do: ": #{inspect(reason)}", else: ""))
    end
  end
end

Listener.readings(3)

# Unplug the chip: the sensor goes down with a reason. Plug it in again: the robot restarts the
# sensor.
BB.Bus.Sim.unplug("i2c-1", 0x48)
Listener.state(:backoff)

BB.Bus.Sim.replug("i2c-1", 0x48)
Listener.state(:up)
Listener.readings(1)

[%{state: :up, restarts: restarts}] = BB.Sensor.health(Greenhouse)
IO.puts("restarts: #{restarts}")

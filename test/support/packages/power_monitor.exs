# A sensor as the driver of a power monitor on I2C is written: options of a schema that is made at
# run time, quantities as options, a loop at a rate.
defmodule PowerMonitor.Chip do
  @moduledoc false

  def open("absent", _address), do: {:error, :no_answer}
  def open(bus, address), do: {:ok, {bus, address}}

  def read({_bus, _address}), do: {:ok, 7400, 20}
end

defmodule PowerMonitor.Sensor do
  @moduledoc false

  use BB.Sensor

  import BB.Unit
  import BB.Unit.Option

  alias BB.Message.Sensor.PowerState
  alias Localize.Unit
  alias PowerMonitor.Chip

  @impl BB.Sensor
  def options_schema do
    Spark.Options.new!(
      bus: [type: :string, required: true, doc: "The I2C bus."],
      address: [type: {:in, 0x40..0x4F}, default: 0x40, doc: "The address of the chip."],
      publish_rate: [type: unit_type(compatible: :hertz), default: ~u(10 hertz)],
      shunt: [type: unit_type(compatible: :ohm, min: ~u(1 milliohm)), default: ~u(0.1 ohm)]
    )
  end

  @impl BB.Sensor
  def init(opts) do
    case Chip.open(opts[:bus], opts[:address]) do
      {:ok, chip} ->
        bb = Keyword.fetch!(opts, :bb)
        state = %{bb: bb, chip: chip, name: List.last(bb.path), loop: nil}
        {:ok, configure(state, opts)}

      {:error, reason} ->
        {:stop, reason}
    end
  end

  @impl BB.Sensor
  def handle_options(opts, state) do
    BB.Loop.cancel(state.loop)
    {:ok, configure(state, opts)}
  end

  defp configure(state, opts) do
    loop = state.bb |> BB.Loop.new(clock: {:rate, opts[:publish_rate]}) |> BB.Loop.arm()
    Map.merge(state, %{loop: loop, ohm: Unit.convert!(opts[:shunt], "ohm").value})
  end

  @impl BB.Sensor
  def handle_info(:tick, state) do
    {_dt, _skipped, loop} = BB.Loop.tick(state.loop)
    {:ok, millivolt, shunt_millivolt} = Chip.read(state.chip)
    shunt_voltage = shunt_millivolt / 1000

    message =
      BB.Message.new!(PowerState, state.name,
        voltage: millivolt / 1000,
        current: shunt_voltage / state.ohm,
        shunt_voltage: shunt_voltage
      )

    BB.publish(state.bb.robot, [:sensor | state.bb.path], message)
    {:noreply, %{state | loop: loop}}
  end

  @impl BB.Sensor
  def terminate(_reason, state) do
    BB.Loop.cancel(state.loop)
    :ok
  end
end

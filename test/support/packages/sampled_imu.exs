# A sensor as the driver of an inertial unit is written that leaves reading to a linked process of
# its own. That process begins with a tick of its own.
defmodule SampledImu.Sampler do
  @moduledoc false

  use GenServer

  def start_link(opts), do: GenServer.start_link(__MODULE__, opts)

  @impl GenServer
  def init(opts) do
    loop = BB.Loop.new(opts[:bb], clock: {:rate, opts[:sample_rate]})
    send(self(), :tick)
    {:ok, %{loop: loop, owner: opts[:owner], range: opts[:range]}}
  end

  @impl GenServer
  def handle_info(:tick, state) do
    {_dt, _skipped, loop} = BB.Loop.tick(state.loop)
    send(state.owner, {:sample, self(), {0, 0, div(32_768, state.range)}, {0, 0, 16}})
    {:noreply, %{state | loop: loop}}
  end
end

defmodule SampledImu.Sensor do
  @moduledoc false

  use BB.Sensor

  import BB.Unit
  import BB.Unit.Option

  alias BB.Math.{Quaternion, Vec3}
  alias BB.Message
  alias BB.Message.Sensor.Imu
  alias SampledImu.Sampler

  @gravity 9.80665

  @impl BB.Sensor
  def options_schema do
    Spark.Options.new!(
      int1_pin: [type: {:or, [:non_neg_integer, nil]}, default: nil],
      range: [type: {:in, [2, 4, 8, 16]}, default: 4, doc: "The range in g."],
      sample_rate: [type: unit_type(compatible: :hertz, max: ~u(6.4 kilohertz))]
    )
  end

  @impl BB.Sensor
  def init(opts) do
    opts = Keyword.put_new(opts, :sample_rate, ~u(100 hertz))
    bb = Keyword.fetch!(opts, :bb)

    with {:ok, sampler} <- Sampler.start_link([owner: self()] ++ opts) do
      {:ok, %{bb: bb, sampler: sampler, range: opts[:range], name: List.last(bb.path)}}
    end
  end

  # The chip is set up once. A new process sets it up again.
  @impl BB.Sensor
  def handle_options(_opts, _state), do: {:stop, :reconfigure}

  @impl BB.Sensor
  def handle_info({:sample, sampler, acceleration, rate}, %{sampler: sampler} = state) do
    {:ok, message} =
      Message.new(Imu, state.name,
        orientation: Quaternion.identity(),
        angular_velocity: scaled(rate, :math.pi() / 180 / 16),
        linear_acceleration: scaled(acceleration, state.range * @gravity / 32_768)
      )

    BB.publish(state.bb.robot, [:sensor | state.bb.path], message)
    {:noreply, state}
  end

  def handle_info(_other, state), do: {:noreply, state}

  defp scaled({x, y, z}, factor), do: Vec3.new(x * factor, y * factor, z * factor)
end

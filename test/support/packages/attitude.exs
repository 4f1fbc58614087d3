# An estimator as a package for attitude and heading is written: a pure filter with the rotation in
# its struct, and readings in, readings with an orientation out.
defmodule Attitude.Filter do
  @moduledoc false

  alias BB.Math.{Quaternion, Vec3}

  defstruct q: Quaternion.identity(), gain: 0.1

  # Integrates the rates, corrected towards the direction of gravity.
  def update(%__MODULE__{q: q} = filter, rate, acceleration, dt) do
    {ex, ey, ez} = tilt_error(q, acceleration)
    x = Vec3.x(rate) + filter.gain * ex
    y = Vec3.y(rate) + filter.gain * ey
    z = Vec3.z(rate) + filter.gain * ez
    half = dt / 2

    turned =
      Quaternion.new(
        q.w - half * (q.x * x + q.y * y + q.z * z),
        q.x + half * (q.w * x + q.y * z - q.z * y),
        q.y + half * (q.w * y - q.x * z + q.z * x),
        q.z + half * (q.w * z + q.x * y - q.y * x)
      )

    %{filter | q: Quaternion.normalise(turned)}
  end

  defp tilt_error(q, acceleration) do
    up = Vec3.normalise(acceleration)
    vx = 2 * (q.x * q.z - q.w * q.y)
    vy = 2 * (q.w * q.x + q.y * q.z)
    vz = q.w * q.w - q.x * q.x - q.y * q.y + q.z * q.z
    {x, y, z} = {Vec3.x(up), Vec3.y(up), Vec3.z(up)}
    {y * vz - z * vy, z * vx - x * vz, x * vy - y * vx}
  end
end

defmodule Attitude.Estimator do
  @moduledoc false

  use BB.Estimator,
    options_schema: [gain: [type: :float, default: 0.5, doc: "The weight of gravity."]]

  alias Attitude.Filter
  alias BB.Message
  alias BB.Message.Sensor.Imu

  @impl BB.Estimator
  def init(opts) do
    %BB.Estimator.Context{target_frame: frame} = Keyword.fetch!(opts, :estimator_context)
    {:ok, %{filter: %Filter{gain: opts[:gain]}, frame: frame, last_ns: nil}}
  end

  @impl BB.Estimator
  def handle_options(opts, state), do: {:ok, put_in(state.filter.gain, opts[:gain])}

  @impl BB.Estimator
  def handle_input(%Message{payload: %Imu{}} = message, %{last_ns: nil} = state),
    do: {:noreply, %{state | last_ns: message.monotonic_time}}

  def handle_input(%Message{payload: %Imu{} = imu, monotonic_time: now} = _message, state) do
    dt = (now - state.last_ns) / 1_000_000_000
    filter = Filter.update(state.filter, imu.angular_velocity, imu.linear_acceleration, dt)

    {:ok, estimate} =
      Imu.new(state.frame,
        orientation: filter.q,
        angular_velocity: imu.angular_velocity,
        linear_acceleration: imu.linear_acceleration
      )

    {:reply, [out: estimate], %{state | filter: filter, last_ns: now}}
  end
end

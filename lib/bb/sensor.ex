defmodule BB.Sensor do
  @moduledoc """
  The behaviour of a sensor's driver. A robot's supervisors run the driver in a process
  (`BB.Sensor.Server`).

  Implement it for a device that reports by itself, or needs a process of its own kind. For a
  device that is polled at a rate, as in this example, `BB.Sensor.Polled` needs less code.

      defmodule MyRobot.Thermometer do
        use BB.Sensor, options_schema: [bus: [type: :string, required: true]]

        @impl BB.Sensor
        def init(opts) do
          with {:ok, handle} <- open(opts[:bus]) do
            loop = BB.Loop.new(opts[:bb], clock: {:rate, 10}) |> BB.Loop.arm()
            {:ok, %{bb: opts[:bb], handle: handle, loop: loop}}
          else
            {:error, reason} -> {:stop, reason}
          end
        end

        @impl BB.Sensor
        def handle_info(:tick, state) do
          {_dt, _skipped, loop} = BB.Loop.tick(state.loop)
          BB.Sensor.publish(state.bb, measure(state.handle))
          {:noreply, %{state | loop: loop}}
        end
      end

  A robot declares the sensor by `sensor :thermometer, {MyRobot.Thermometer, bus: "i2c-1"}`.

  ## Options

  Declare the driver's options in the format of `BB.Options`, either by `use BB.Sensor,
  options_schema: […]` or by a function `options_schema/0`. A driver without a schema takes no
  options. Options are checked, and defaults are set, before `init/1`; wrong options fail the
  robot's start. `init/1` also receives

    * `opts[:bb]` - `%{robot: robot_module, path: path}`, the path as `[:base_link, :imu]`
    * `opts[:sensor_profile]` - a `BB.Sensor.SensorProfile`

  An option may refer to a parameter (`BB.Parameter`): `rate: param([:imu, :rate])` in the robot.
  The driver receives the parameter's value. When the value changes, `handle_options/2` receives
  all options again, once for each change, and once when `BB.Parameter.set_many/2` changes several
  parameters. A value that the schema refuses stops the sensor, which is down until the parameter
  is right. In the same way `opts[:sensor_profile].transmission` follows its parameters.

  ## Failures

  A driver need not crash when its device does not answer. It returns `{:stop, reason}` from
  `init/1`, or `{:stop, reason, state}` from a later callback, with a reason that tells a person
  what to do. Wrap the reason in `{:shutdown, reason}`, and OTP logs no crash. The sensor then
  goes down alone and is restarted, at first within 100 ms, then less often
  (`BB.Component.Backoff`), until it is up. A crash is handled in the same way, with OTP's report
  in the log. A process that is linked to the driver takes the sensor down when it fails.

  Each change of the sensor's status is published as a `BB.Message.Sensor.Status` on
  `[:sensor_status | path]`, sets or clears the OTP alarm `{BB.Sensor, robot, path}`, and shows in
  `health/1`.

  Never publish an old reading as a new one. When the device stops answering, publish nothing;
  with `max_silence` in the robot's declaration the sensor becomes `:stale`. A sensor that
  publishes elsewhere than on its own path calls `beat/0` to show that it is well.
  """

  use BB.Component.Kind, word: :sensor

  alias BB.{Message, PubSub, Transmission}
  alias BB.Component.{Health, Heartbeat, Reason, Server}
  alias BB.Message.Sensor.JointState
  alias BB.Sensor.SensorProfile
  alias BB.Transmission.Resolver

  @doc false
  @impl BB.Component
  def component_options(joint, transmission) do
    profile = %SensorProfile{joint_name: joint && joint.name, transmission: transmission}
    [sensor_profile: profile]
  end

  @doc """
  Returns the health of the robot's sensors, in the order of their declaration.

  Raises `ArgumentError` when the robot is not started.
  """
  @spec health(module()) :: [Health.row()]
  def health(robot), do: Health.list(robot, __MODULE__)

  @doc """
  Formats the reason for which a sensor is down, from its `health/1` row or its
  `BB.Message.Sensor.Status`.

  `module` is the sensor's driver, whose `c:explain/1` formats the reason if it has a clause for
  it.

      iex> BB.Sensor.explain(BB.Sensor.Mpu6050, {:no_answer, "i2c-1", 0x68})
      "no answer at 0x68 on i2c-1: check wiring and power"
      iex> BB.Sensor.explain(BB.Sensor.Mpu6050, {:silent, 250})
      "published nothing for 250 ms"
  """
  @spec explain(module(), reason :: term()) :: String.t()
  def explain(module, reason), do: Reason.format(reason, module)

  @doc """
  Records a heartbeat of the calling sensor, which counts for `max_silence` as a message does.

  Use it in a sensor that publishes elsewhere than on its own path, as an outlet does. `time_ns`
  is the monotonic time. The sensor's own process calls it.
  """
  @spec beat(integer()) :: :ok
  def beat(time_ns \\ System.monotonic_time(:nanosecond)), do: Heartbeat.beat(time_ns)

  @doc """
  Reports trouble of the calling sensor, which runs on.

  The reason becomes the `last_error` of its `health/1` row, and `c:explain/1` formats it as
  `error`; the state does not change. Report trouble once, not with each message. The sensor's own
  process calls it.
  """
  @spec trouble(reason :: term()) :: :ok
  defdelegate trouble(reason), to: Server

  @doc """
  Returns the `max_silence` of the calling sensor in nanoseconds, or `nil` when it has none.
  """
  @spec max_silence_ns() :: pos_integer() | nil
  defdelegate max_silence_ns, to: Heartbeat

  @doc """
  Sets how many milliseconds `terminate/2` of the calling sensor may take before the sensor is
  killed.

  The default is 5000. The sensor's own process calls it.
  """
  @spec shut_down_within(non_neg_integer()) :: :ok
  defdelegate shut_down_within(ms), to: Heartbeat

  @doc "Publishes a sensor's message on its path, `[:sensor | path]`."
  @spec publish(bb(), Message.t()) :: :ok
  def publish(%{robot: robot, path: path}, message),
    do: PubSub.publish(robot, [:sensor | path], message)

  @doc """
  Converts a sensor's message into the space of its joint, by the sensor's transmission.

  The fields of the transmission may refer to parameters. Without a transmission the message does
  not change. `sensor_path` is the path of `opts[:bb]`.
  """
  @spec to_joint_space(module(), [atom(), ...], Message.t()) :: Message.t()
  def to_joint_space(robot, sensor_path, %Message{} = message) do
    transmission = Resolver.resolve(robot, :sensor, List.last(sensor_path))
    Transmission.unapply_to_payload(message, transmission)
  end

  @doc """
  Publishes a `BB.Message.Sensor.JointState` on `[:sensor | path]`.

  `opts` are the fields of the payload; `:names` is `[frame_id]` by default. The frame_id is the
  name of the joint to which the sensor is attached, or else the sensor's name. The values are
  those that the sensor measures; they are published in the space of the joint
  (`to_joint_space/3`). Wrong fields raise `BB.Options.ValidationError`.
  """
  @spec publish_joint_state(module(), [atom(), ...], keyword()) :: :ok
  def publish_joint_state(robot, path, opts) do
    name = List.last(path)
    frame_id = Resolver.joint(robot, :sensor, name) || name
    message = Message.new!(JointState, frame_id, Keyword.put_new(opts, :names, [frame_id]))
    publish(%{robot: robot, path: path}, to_joint_space(robot, path, message))
  end
end

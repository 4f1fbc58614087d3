defmodule BB.Sensor do
  @moduledoc """
  A sensor's driver: a module with callbacks, which a robot's supervisors run in a process (`BB.Sensor.Server`).

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

  and in the robot: `sensor :thermometer, {MyRobot.Thermometer, bus: "i2c-1"}`. For a device that is asked at a rate, as this one,
  `BB.Sensor.Polled` has all but the asking.

  ## Options

  Say what options the driver takes, in the format of `BB.Options`, either by `use BB.Sensor, options_schema: […]` or by a
  function `options_schema/0`, not both; without a schema it takes none. Options are checked, and defaults filled in, before
  `init/1`; wrong ones fail the robot's start. Beside them `init/1` gets

    * `opts[:bb]` - `%{robot: robot_module, path: path}`, the path as `[:base_link, :imu]`
    * `opts[:sensor_profile]` - `BB.Sensor.SensorProfile`

  An option may follow a parameter (`BB.Parameter`): `rate: param([:imu, :rate])` in the robot. The driver gets the parameter's value, and
  when that changes `handle_options/2` gets all options anew, once for each change: once too when `BB.Parameter.set_many/2` has changed
  several of them. A value that the schema refuses stops the sensor, which is down until the parameter is right. In the
  same way `opts[:sensor_profile].transmission` follows its parameters.

  ## When things go wrong

  A device that does not answer is no reason to crash: return `{:stop, reason}` from `init/1`, or `{:stop, reason, state}` from
  a later callback, with a reason that a person can act on; as `{:shutdown, reason}` it is no crash in OTP's log. The sensor then goes down alone and is started again, at first
  within 100 ms, then less often (`BB.Component.Backoff`), until it is up. A crash is handled in the same way, with OTP's report
  in the log. A process that the driver links to itself takes it down when it fails.

  Each change is published as `BB.Message.Sensor.Status` on `[:sensor_status | path]`, set or cleared as the OTP alarm
  `{BB.Sensor, robot, path}`, and visible in `health/1`.

  Never publish an old reading as a new one. When the device stops answering, publish nothing;
  with `max_silence` in the robot's declaration the sensor is then `:stale`. A sensor whose work
  does not show in messages on its own path says by `beat/0` that it is well.
  """

  use BB.Component.Kind, word: :sensor

  alias BB.{Message, Parameter, PubSub, Transmission}
  alias BB.Component.{Health, Heartbeat, Reason, Server}
  alias BB.Message.Sensor.JointState
  alias BB.Sensor.SensorProfile

  @doc false
  @impl BB.Component
  def component_options(joint_name, transmission),
    do: [sensor_profile: %SensorProfile{joint_name: joint_name, transmission: transmission}]

  @doc """
  How each of the robot's sensors fares, in the order of their declaration: a list of `t:BB.Component.Health.row/0`.

  Raises `ArgumentError` when the robot is not started.
  """
  @spec health(module()) :: [Health.row()]
  def health(robot), do: Health.list(robot, __MODULE__)

  @doc """
  Why a sensor is down, for a person: the `reason` of its `health/1` row or of its `BB.Message.Sensor.Status`, in the words of its driver
  `module` where that has some (`c:explain/1`).

      iex> BB.Sensor.explain(BB.Sensor.Mpu6050, {:no_answer, "i2c-1", 0x68})
      "no answer at 0x68 on i2c-1: check wiring and power"
      iex> BB.Sensor.explain(BB.Sensor.Mpu6050, {:silent, 250})
      "published nothing for 250 ms"
  """
  @spec explain(module(), reason :: term()) :: String.t()
  def explain(module, reason), do: Reason.format(reason, module)

  @doc """
  Says, in the sensor's own process, that it is well: it did what `max_silence` asks for.

  For what publishes elsewhere than on its own path, as an outlet does. `time_ns` is the monotonic
  time.
  """
  @spec beat(integer()) :: :ok
  def beat(time_ns \\ System.monotonic_time(:nanosecond)), do: Heartbeat.beat(time_ns)

  @doc """
  Says, in the sensor's own process, that something is wrong although the sensor goes on.

  The reason is the `last_error` of its `health/1` row then, and in the words of `c:explain/1` its
  `error`; its state stays what it is. Say it once, not with each message.
  """
  @spec trouble(reason :: term()) :: :ok
  defdelegate trouble(reason), to: Server

  @doc "How long the sensor of the calling process may be silent, in nanoseconds; `nil` for ever."
  @spec max_silence_ns() :: pos_integer() | nil
  defdelegate max_silence_ns, to: Heartbeat

  @doc """
  Says, in the sensor's own process, how many milliseconds its `terminate/2` may take, 5000 by
  default: its end is waited for so long before it is killed.
  """
  @spec shut_down_within(non_neg_integer()) :: :ok
  defdelegate shut_down_within(ms), to: Heartbeat

  @doc "Publishes a sensor's message on its path, `[:sensor | path]`."
  @spec publish(bb(), Message.t()) :: :ok
  def publish(%{robot: robot, path: path}, message),
    do: PubSub.publish(robot, [:sensor | path], message)

  @doc """
  A sensor's message in the space of its joint: through the sensor's transmission, whose fields may follow parameters. The
  same message where there is no transmission.

  `sensor_path` is that of `opts[:bb]`.
  """
  @spec to_joint_space(module(), [atom(), ...], Message.t()) :: Message.t()
  def to_joint_space(robot, sensor_path, %Message{} = message) do
    declared = attached(robot, List.last(sensor_path)).transmission

    case Transmission.resolve(declared, &Parameter.get!(robot, &1)) do
      {:ok, transmission} -> Transmission.unapply_to_payload(message, transmission)
      {:error, error} -> raise error
    end
  end

  @doc """
  Publishes a `BB.Message.Sensor.JointState` on `[:sensor | path]`.

  `opts` are its fields; `names` is `[frame_id]` when not given. The frame_id is the joint's name where the sensor is attached
  to a joint, else the sensor's. Values are those that the sensor sees; they are published in the space of the joint
  (`to_joint_space/3`). Fields that are wrong raise `BB.Options.ValidationError`.
  """
  @spec publish_joint_state(module(), [atom(), ...], keyword()) :: :ok
  def publish_joint_state(robot, path, opts) do
    name = List.last(path)

    frame_id =
      with {:joint, joint} <- attached(robot, name).attached_to, do: joint, else: (_ -> name)

    message = Message.new!(JointState, frame_id, Keyword.put_new(opts, :names, [frame_id]))
    publish(%{robot: robot, path: path}, to_joint_space(robot, path, message))
  end

  @nowhere %{attached_to: nil, transmission: nil}

  # A driver's test need not have a robot.
  defp attached(robot, name) do
    if Code.ensure_loaded?(robot) and function_exported?(robot, :robot, 0),
      do: Map.get(robot.robot().sensors, name, @nowhere),
      else: @nowhere
  end
end

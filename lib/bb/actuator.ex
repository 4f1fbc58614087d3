defmodule BB.Actuator do
  @moduledoc """
  The behaviour of an actuator's driver, and the functions that command an actuator. A robot's
  supervisors run the driver in a process, as they run a sensor (`BB.Actuator.Server`).

  Implement it for hardware that moves a joint.

      defmodule MyRobot.Servo do
        use BB.Actuator, options_schema: [channel: [type: :integer, required: true]]

        alias BB.Message.Actuator.Command.Position

        @impl BB.Actuator
        def init(opts), do: open(opts[:channel], opts[:motor_profile])

        @impl BB.Actuator
        def disarm(opts), do: stop(opts[:channel])

        @impl BB.Actuator
        def command_payloads(_opts), do: [Position]

        @impl BB.Actuator
        def handle_command(%BB.Message{payload: %Position{position: angle}}, state),
          do: {:noreply, turn_to(state, angle)}
      end

  A joint of the robot declares the actuator:

      actuator :servo, {MyRobot.Servo, channel: 0} do
        transmission reduction: 3.0
      end

  A program commands it while the robot is armed:

      :ok = BB.Safety.arm(MyRobot)
      :ok = BB.Actuator.set_position(MyRobot, :servo, 0.5)

  ## The driver

  `init/1` receives the driver's options, `opts[:bb]`, `opts[:motor_profile]` (the limits of the
  motor, `BB.Actuator.MotorProfile`) and `opts[:actuator_profile]`
  (`BB.Actuator.ActuatorProfile`). Options, limits and transmission may refer to parameters. The
  sections "Options" and "Failures" of `BB.Sensor` apply. Changes of the actuator's status are
  published on `[:actuator_status | path]`, and its alarm is `{BB.Actuator, robot, path}`.

  ## Commands

  A command is a `BB.Message` whose payload is a `BB.Message.Actuator.Command` or another payload
  that the driver declares (`c:command_payloads/1`). It reaches the actuator as
  `{:command, message}` by call or cast, or on the path `[:actuator | path]`, to which its process
  subscribes. The transmission converts it from joint space to the motor's space. Then
  `c:handle_command/2` handles it.

  A command is refused, and never reaches the driver,

    1. when the driver does not declare its payload (`BB.Error.State.UnsupportedCommand`),
    2. when the robot is not armed (`BB.Error.State.NotArmed`),
    3. when it does not have the epoch of the present arming in `arm_epoch`
       (`BB.Error.State.StaleEpoch`). The functions below put it into their messages.

  Each refusal is logged and emitted as the telemetry event `[:bb, :actuator, :rejected]`.

  ## Sending

  The functions that send a command take the actuator's name or its path. Their options are those
  of the command and

    * `delivery` - how the command reaches the actuator
      * `:pubsub` - it is published for observers, and the actuator is called. Returns `:ok`, or
        `{:error, reason}` from the driver or for a refusal. Exits as `GenServer.call/3` does when
        the actuator is down or late
      * `:broadcast` - it is published, and the actuator receives it as a subscriber. Returns
        `:ok`
      * `:direct` - it is cast to the actuator and not published. Returns `:ok`
    * `command_id` - a reference, which the messages about the motion repeat
    * `timeout` - of the call with `:pubsub`, in milliseconds or `:infinity` (5000)
    * `reply_on_reject?` - with `:direct`, whether the caller receives
      `{:bb, :command_rejected, name, command_id, error}` for a refusal (`false`)

  A wrong option raises `BB.Options.ValidationError`, an unknown name `ArgumentError`.
  """

  use BB.Component.Kind, word: :actuator, disarm: :required

  alias BB.Actuator.{ActuatorProfile, CommandCheck, Delivery, MotorProfile}
  alias BB.Component.{Callbacks, Health, Reason}
  alias BB.{Message, PubSub, Transmission}
  alias BB.Message.Actuator.BeginMotion
  alias BB.Message.Actuator.Command.{Effort, Hold, Position, Stop, Trajectory, Velocity}
  alias BB.Transmission.Resolver

  @typedoc "The name of an actuator, or its path."
  @type target :: Delivery.target()

  @typedoc "What the actuator measures of its joint, so that no sensor is needed for it."
  @type capability :: :position_feedback | :velocity_feedback | :effort_feedback

  @doc """
  Handles a command, whose numbers are in the motor's space.

  A call of the command returns the reply, or `{:ok, :accepted}` when there is none.
  """
  @callback handle_command(Message.t(), state :: term()) ::
              {:reply, reply :: term(), new_state :: term()}
              | {:reply, reply :: term(), new_state :: term(), next()}
              | noreply()

  @doc "Returns what the actuator measures with these options. The default is `[]`."
  @callback capabilities(opts :: keyword()) :: [capability()]

  @doc """
  Returns the payloads of the commands that the driver handles with these options.

  The default is `default_command_payloads/0`.
  """
  @callback command_payloads(opts :: keyword()) :: [module()]

  @optional_callbacks capabilities: 1, command_payloads: 1

  @doc false
  defmacro __using__(opts) do
    quote do
      unquote(Callbacks.code(__MODULE__, opts))

      @doc false
      def capabilities(_opts), do: []

      @doc false
      def command_payloads(_opts), do: BB.Actuator.default_command_payloads()

      defoverridable capabilities: 1, command_payloads: 1
    end
  end

  @doc false
  @impl BB.Component
  def component_options(joint, transmission) do
    name = joint && joint.name

    [
      motor_profile: MotorProfile.from_joint(joint, transmission),
      actuator_profile: %ActuatorProfile{joint_name: name, transmission: transmission}
    ]
  end

  @doc false
  @impl BB.Component
  defdelegate component_start(module, options), to: CommandCheck, as: :start

  @doc false
  @impl BB.Component
  defdelegate component_request(transport, request, check, options),
    to: CommandCheck,
    as: :decide

  @doc """
  Returns the payloads that a driver handles unless it declares others.

      iex> BB.Actuator.default_command_payloads() |> Enum.map(&List.last(Module.split(&1)))
      ["Effort", "Hold", "Position", "Stop", "Trajectory", "Velocity"]
  """
  @spec default_command_payloads() :: [module()]
  def default_command_payloads, do: CommandCheck.default_payloads()

  @doc "Returns the health of the robot's actuators, as `BB.Sensor.health/1` does of its sensors."
  @spec health(module()) :: [Health.row()]
  def health(robot), do: Health.list(robot, __MODULE__)

  @doc "Formats the reason for which an actuator is down, as `BB.Sensor.explain/2` does."
  @spec explain(module(), reason :: term()) :: String.t()
  def explain(module, reason), do: Reason.format(reason, module)

  # Commands

  @doc """
  Commands an actuator to move its joint to a position, in rad or m.

  Options: `velocity`, a float in rad/s or m/s, and `duration` in milliseconds, both wishes, and
  those of "Sending". The default delivery is `:pubsub`.
  """
  @spec set_position(module(), target(), number(), keyword()) :: :ok | {:error, term()}
  def set_position(robot, target, position, opts \\ []) when is_number(position),
    do: Delivery.send_command(robot, target, Position, [position: position / 1], opts, :pubsub)

  @doc """
  Calls an actuator to move its joint to a position, and returns its answer:
  `{:ok, :accepted}`, the driver's reply, or `{:error, reason}`.

  The command is not published. Code for version 0.30 of Beam Bots calls it; new code calls
  `set_position/4`.
  """
  @spec set_position_sync(module(), target(), number(), keyword(), timeout()) :: term()
  def set_position_sync(robot, target, position, opts \\ [], timeout \\ 5_000)
      when is_number(position),
      do: Delivery.call(robot, target, Position, [position: position / 1], opts, timeout)

  @doc """
  Commands an actuator to move its joint with a velocity, in rad/s or m/s.

  Options: `duration` in milliseconds, and those of "Sending". The default delivery is
  `:broadcast`.
  """
  @spec set_velocity(module(), target(), number(), keyword()) :: :ok | {:error, term()}
  def set_velocity(robot, target, velocity, opts \\ []) when is_number(velocity),
    do: Delivery.send_command(robot, target, Velocity, [velocity: velocity / 1], opts, :broadcast)

  @doc """
  Commands an actuator to apply an effort to its joint, in N·m or N.

  Options: `duration` in milliseconds, and those of "Sending". The default delivery is
  `:broadcast`.
  """
  @spec set_effort(module(), target(), number(), keyword()) :: :ok | {:error, term()}
  def set_effort(robot, target, effort, opts \\ []) when is_number(effort),
    do: Delivery.send_command(robot, target, Effort, [effort: effort / 1], opts, :broadcast)

  @doc """
  Commands an actuator to follow waypoints.

  A waypoint is a map or a keyword list with `position` and `time_from_start` in milliseconds, and
  optionally `velocity` and `acceleration`. Options: `repeat`, a number or `:forever` (1), and
  those of "Sending". The default delivery is `:broadcast`.
  """
  @spec follow_trajectory(module(), target(), [keyword() | map()], keyword()) ::
          :ok | {:error, term()}
  def follow_trajectory(robot, target, waypoints, opts \\ []) when is_list(waypoints) do
    fields = [waypoints: Enum.map(waypoints, &waypoint/1)]
    Delivery.send_command(robot, target, Trajectory, fields, opts, :broadcast)
  end

  @numbers [:position, :velocity, :acceleration]

  defp waypoint(fields) when is_map(fields) or is_list(fields) do
    given = for {key, value} <- fields, do: {key, to_float(key, value)}
    Keyword.merge([velocity: nil, acceleration: nil], given)
  end

  defp waypoint(other), do: other

  defp to_float(key, number) when key in @numbers and is_number(number), do: number / 1
  defp to_float(_key, value), do: value

  @doc """
  Commands an actuator to stop.

  Options: `mode`, `:immediate` (the default) or `:decelerate`, and those of "Sending". The
  default delivery is `:broadcast`. It is a command as any other, and refused while the robot is
  not armed: `BB.Safety.disarm/1` makes a robot safe.
  """
  @spec stop(module(), target(), keyword()) :: :ok | {:error, term()}
  def stop(robot, target, opts \\ []),
    do: Delivery.send_command(robot, target, Stop, [], opts, :broadcast)

  @doc """
  Commands an actuator to hold its joint where it is.

  Options: those of "Sending". The default delivery is `:broadcast`.
  """
  @spec hold(module(), target(), keyword()) :: :ok | {:error, term()}
  def hold(robot, target, opts \\ []),
    do: Delivery.send_command(robot, target, Hold, [], opts, :broadcast)

  # Reports of the driver

  @doc """
  Publishes on `[:actuator | path]` that an actuator begins to move.

  `opts` are the fields of a `BB.Message.Actuator.BeginMotion`, in the motor's space. The message
  is in the space of the joint, and its frame_id is the joint's name.
  """
  @spec publish_begin_motion(module(), [atom(), ...], keyword()) :: :ok
  def publish_begin_motion(robot, path, opts) do
    name = List.last(path)
    frame_id = Resolver.joint(robot, :actuator, name) || Enum.at(path, -2, name)
    message = Message.new!(BeginMotion, frame_id, opts)
    PubSub.publish(robot, [:actuator | path], to_joint_space(robot, path, message), [])
  end

  @doc """
  Converts a message of an actuator into the space of its joint, by the actuator's transmission,
  as `BB.Sensor.to_joint_space/3` does for a sensor.
  """
  @spec to_joint_space(module(), [atom(), ...], Message.t()) :: Message.t()
  def to_joint_space(robot, actuator_path, %Message{} = message) do
    transmission = Resolver.resolve(robot, :actuator, List.last(actuator_path))
    Transmission.unapply_to_payload(message, transmission)
  end
end

defmodule BB.Safety do
  @moduledoc """
  Arms and disarms robots. Use it wherever something moves: to allow movement, to end it, and to
  forbid it.

      :ok = BB.Safety.arm(MyRobot)
      true = BB.Safety.armed?(MyRobot)
      :ok = BB.Safety.disarm(MyRobot)

  A robot is `:disarmed` when it starts. `arm/1` allows it to move. `disarm/2` makes its hardware
  safe: it calls `disarm/1` of every component with that callback, all at once, and waits for
  them.

                arm                    disarm, or the robot's tree ends
      :disarmed ───► :armed ──────────────────────────► :disarming
          ▲                                             │        │ a handler fails,
          ├─────────────────────────────────────────────┘        │ or the topology has died
          └───────────────────── :error ◄────────────────────────┘
                 force_disarm

  An actuator calls `armed?/1` at each command and does nothing unless it returns `true`. The call
  is an ETS look-up; it takes a fraction of a microsecond and waits for no process. Each
  transition is published as `BB.StateMachine.Transition` on `[:state_machine]` and emitted as
  the telemetry event `[:bb, :safety, :transition]`. Each disarming is a telemetry span
  `[:bb, :safety, :disarm]`.

  ## Handlers

  The handler of a component is the `disarm/1` of its module. It is registered before `init/1` is
  called, with the options of `init/1`. `disarm/1` runs in a process of its own, with those
  options alone: its component may be dead, hang, or cause the trouble. So it opens the device
  again, or calls the process of its bus, never that of its component. It returns `:ok` only if
  the hardware is safe.

    * A handler outlives its process. It stays until a successor registers the same path, or until
      its process is dead and its `disarm/1` has run without a failure. So an actuator that is
      down at the time of a disarming becomes safe too.
    * A handler of a process outside of the robot's tree stays as long as that process lives,
      however often the robot starts again.
    * A path has one handler: a new registration replaces the old one.
    * A handler that is registered while the robot is `:disarming` belongs to the next disarming,
      because its hardware was never armed.
    * A handler may call the functions of this module. `disarm/2` returns
      `{:error, :already_disarming}` to it.

  ## Commands that arm and disarm

  A robot may declare a command for each (`BB.Command`, `arm true` and `disarm true`), to home its
  joints first, or to rest before the power is gone. `arm/1` and `disarm/2` then execute the
  command and return when it has ended. When the disarm command fails before the robot is safe,
  the handlers run, the robot is in the state `:error`, and `disarm/2` returns
  `{:error, {:disarm_command_failed, reason}}`.

  The commands themselves, and whatever must not wait for a command, such as an emergency stop,
  call `BB.Safety.Controller.arm/1` and `BB.Safety.Controller.disarm/2`.

  ## When the robot ends

  An armed robot is disarmed when its root supervisor or its topology supervisor dies, for any
  reason: each handler runs once. When the topology supervisor dies and the root lives, the state
  is `:error` however the handlers went: something unforeseen has happened, and a person has to
  look before `force_disarm/1`. A robot that is stopped (`Supervisor.stop/1`, or with its
  application) is disarmed after its components have ended, and the stop waits for that. No
  handler runs for a robot that is not armed.

  A robot that starts again while its predecessor is `:disarming` cannot be armed until the
  disarming is over. The state `:error` stays too, until `force_disarm/1`.

  Each robot has a warden, a process outside the robot's tree (`BB.Safety.Warden`), so that no
  robot waits for the handlers of another. The warden keeps its knowledge in ETS: when it is
  killed, states and handlers stay, and its successor continues a disarming without calling a
  handler twice.

  ## When the application ends

  Every armed robot is disarmed when the application `:ganglion` ends, for any reason, also a
  robot that another application has started. Such a robot keeps running, disarmed, and cannot
  be armed until the application is started again. The processes of safety stand outside of the
  application (`BB.Safety.Supervisor`), so that no bus, simulation or robot can end them.

  ## Limits

  No handler runs when the whole VM is killed or the power fails. An emergency stop that people
  rely on cuts the power of the actuators by a circuit. Use this module for everything before
  that.
  """

  alias BB.{Message, Path, PubSub}
  alias BB.Safety.{HardwareError, Record, Records, Round, Route, Warden, Wardens}

  @type state :: Record.state()
  @type disarm_error :: Round.error()

  @type arm_error ::
          :already_armed
          | :disarming
          | :in_error
          | :not_registered
          | :not_running
          | {:inhibited, [{Path.t(), reason :: term()}, ...]}
          | (reason_of_the_arm_command :: term())

  @doc """
  Returns whether the robot is armed: `false` for an unknown robot.

      iex> BB.Safety.armed?(NoRobot)
      false
  """
  @spec armed?(module()) :: boolean()
  def armed?(robot), do: Records.state(robot) == :armed

  @doc """
  Returns the robot's state: `:disarmed` for an unknown robot.

      iex> BB.Safety.state(NoRobot)
      :disarmed
  """
  @spec state(module()) :: state()
  def state(robot), do: Records.state(robot)

  @doc """
  Returns whether the robot is in the state `:error`: `false` for an unknown robot.

      iex> BB.Safety.in_error?(NoRobot)
      false
  """
  @spec in_error?(module()) :: boolean()
  def in_error?(robot), do: Records.state(robot) == :error

  @doc """
  Returns whether the robot is being disarmed: `false` for an unknown robot.

      iex> BB.Safety.disarming?(NoRobot)
      false
  """
  @spec disarming?(module()) :: boolean()
  def disarming?(robot), do: Records.state(robot) == :disarming

  @doc """
  Returns the number of the robot's arming: `{:ok, epoch}` while it is armed, and `:error`
  otherwise, also for an unknown robot.

  Each arming has an epoch of its own, greater than all before. A command that carries the epoch
  in which it was computed shows that it is old when the robot was disarmed and armed again
  since.

      iex> BB.Safety.epoch(NoRobot)
      :error
  """
  @spec epoch(module()) :: {:ok, pos_integer()} | :error
  def epoch(robot), do: Records.epoch(robot)

  @doc """
  Arms the robot. Errors:

    * `:already_armed`
    * `:disarming` - a disarming is in progress
    * `:in_error` - a disarming failed; see `force_disarm/1`
    * `:not_registered` - the robot is not started
    * `:not_running` - the application `:ganglion` is not running; start it again
    * `{:inhibited, [{path, reason}]}` - these paths forbid arming; see `inhibit/3`
    * any other reason - the error of the robot's arm command, if it has one
  """
  @spec arm(module()) :: :ok | {:error, arm_error()}
  def arm(robot), do: Route.arm(robot)

  @doc """
  Disarms the robot. Calls all handlers at once, and returns when the last one has returned or
  `timeout` milliseconds have passed.

  Returns `:ok` if every handler returned `:ok`. Errors:

    * `:already_disarmed`, `:already_disarming`, `:already_in_error` - no handler was called
    * `:not_registered` - the robot is not started
    * `{:disarm_command_failed, reason}` - the robot's disarm command failed, and the robot is in
      the state `:error`
    * `{:disarm_failed, [{path, error}]}` - the hardware of these paths may not be safe, and the
      robot is in the state `:error`. An error is
      * `{:returned_error, reason}` - the handler returned `{:error, reason}`; the reason is
        `{:bad_return_value, term}` if it returned anything else but `:ok`
      * `{:exception, message}` - the handler raised
      * `{:throw, value}` or `{:exit, reason}` - the handler threw, exited or was killed
      * `{:timeout, ms}` - the handler did not return in time, and was killed

  Options: `timeout:` in milliseconds (default: #{Warden.default_timeout_ms()}).
  """
  @spec disarm(module(), timeout: pos_integer()) ::
          :ok
          | {:error,
             :already_disarmed
             | :already_disarming
             | :already_in_error
             | :not_registered
             | {:disarm_command_failed, reason :: term()}
             | {:disarm_failed, [{Path.t(), disarm_error()}, ...]}}
  def disarm(robot, opts \\ []), do: Route.disarm(robot, timeout_ms!(opts))

  @doc """
  Moves a robot from `:error` to `:disarmed` without calling a handler.

  Call it only after a person has checked that the hardware is safe. A robot that has ended is
  forgotten then.

  Errors: `:not_in_error`, `:not_registered`.
  """
  @spec force_disarm(module()) :: :ok | {:error, :not_in_error | :not_registered}
  def force_disarm(robot), do: Wardens.force_disarm(robot)

  @doc """
  Registers `module.disarm/1` as the handler for a path of a robot. It replaces the handler of
  that path.

  Call it for hardware without a component. The server of a component registers its handler.

  Options: `robot:` and `path:`, both required, and `opts:`, the argument of the handler (default:
  `[]`).

  A robot that is not started becomes known by this call. The calling process takes the place of
  its root.
  """
  @spec register(module(), robot: module(), path: Path.t(), opts: keyword()) :: :ok
  def register(module, options) do
    options = Keyword.validate!(options, [:robot, :path, opts: []])
    robot = robot!(options[:robot])
    path = Path.validate!(options[:path])
    handler!(module)
    ensure_known(robot)
    Records.register(robot, path, self(), module, options[:opts])

    # The robot may have ended meanwhile.
    ensure_known(robot)
  end

  defp ensure_known(robot),
    do: if(Records.known?(robot), do: :ok, else: Wardens.watch(robot, :component))

  @doc """
  Forbids arming until `allow/2` is called for the same path, whichever process dies meanwhile.
  `arm/1` returns `reason` in its error.

  Call it from the voucher of the path, such as an emergency stop that is pressed or a lid that is
  open. It does not disarm a robot that is armed:

      BB.Safety.inhibit(robot, path, :pressed)
      BB.Safety.disarm(robot)

  In this order the robot cannot be armed in between. See also `vouch/2`.
  """
  @spec inhibit(module(), Path.t(), reason :: term()) :: :ok
  def inhibit(robot, path, reason) do
    Records.inhibit(robot!(robot), Path.validate!(path), reason)
    :ok
  end

  @doc "Removes the inhibition of a path. Returns `:ok` also when the path had none."
  @spec allow(module(), Path.t()) :: :ok
  def allow(robot, path) do
    Records.allow(robot!(robot), Path.validate!(path))
    :ok
  end

  @doc """
  Removes the inhibition of a path for as long as the calling process lives.

  When that process ends, for any reason, the path forbids arming again, with the reason
  `:unattended`, and an armed robot is disarmed at once, without a moment in between. A voucher
  calls this instead of `allow/2`: the robot cannot be armed, and does not stay armed, without its
  voucher. The successor of the process vouches again. `allow/2` ends the vouching.

      BB.Safety.inhibit(robot, path, :starting)
      …
      BB.Safety.vouch(robot, path)

  The process may be outside of the robot's tree and may vouch before the robot is started. The
  vouching holds however often the robot is started again.

  A robot that is not started becomes known by this call. The calling process takes the place of
  its root.
  """
  @spec vouch(module(), Path.t()) :: :ok
  def vouch(robot, path), do: Wardens.vouch(robot!(robot), Path.validate!(path))

  @doc "Returns the inhibitions of a robot: `[{path, reason}]`."
  @spec inhibitions(module()) :: [{Path.t(), reason :: term()}]
  def inhibitions(robot), do: Records.inhibitions(robot!(robot))

  @doc """
  Publishes a fault of the hardware, as `BB.Safety.HardwareError` on `[:safety, :error]`. The
  subscribers decide what follows.

  Raises `ArgumentError` when the robot is not started.
  """
  @spec report_error(module(), Path.t(), error :: term()) :: :ok
  def report_error(robot, path, error) do
    message =
      Message.new!(HardwareError, frame_id(Path.validate!(path)), path: path, error: error)

    PubSub.publish(robot, [:safety, :error], message)
  end

  defp frame_id(path) do
    case List.last(path) do
      name when is_atom(name) and name != nil -> name
      _other -> :safety
    end
  end

  defp handler!(module) do
    unless is_atom(module) and Code.ensure_loaded?(module) and
             function_exported?(module, :disarm, 1),
           do: raise(ArgumentError, "expected a module with disarm/1, got: #{inspect(module)}")
  end

  defp robot!(robot) when is_atom(robot) and robot != nil, do: robot

  defp robot!(robot),
    do: raise(ArgumentError, "expected the module of a robot, got: #{inspect(robot)}")

  @doc false
  def timeout_ms!(opts) do
    case Keyword.validate!(opts, timeout: Warden.default_timeout_ms())[:timeout] do
      timeout_ms when is_integer(timeout_ms) and timeout_ms > 0 ->
        timeout_ms

      other ->
        raise ArgumentError,
              "invalid value for :timeout option: expected milliseconds above zero, " <>
                "got: #{inspect(other)}"
    end
  end
end

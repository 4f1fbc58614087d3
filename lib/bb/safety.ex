defmodule BB.Safety do
  @moduledoc """
  Whether a robot may move, and what makes it safe again.

  A robot is `:disarmed` when it starts. `arm/1` lets it move, `disarm/2` makes its hardware safe:
  it calls `disarm/1` of every component that has one, all at once, and waits for them.

                arm                    disarm, or the robot's tree ends
      :disarmed ───► :armed ──────────────────────────► :disarming
          ▲                                             │        │
          ├─────────────────────────────────────────────┘        │ a handler fails
          └───────────────────── :error ◄────────────────────────┘
                 force_disarm

  An actuator asks `armed?/1` at each command and does nothing unless it is true: that is a
  look-up, which takes a fraction of a microsecond and waits for nobody. Each transition is
  published as `BB.StateMachine.Transition` on `[:state_machine]` and emitted as the telemetry
  event `[:bb, :safety, :transition]`; each disarming is a telemetry span `[:bb, :safety,
  :disarm]`.

  ## Handlers

  A component whose module has `disarm/1` is registered before its `init/1` is called, with the
  options that `init/1` gets. `disarm/1` runs in a process of its own, with nothing but those
  options: its component may be dead, hang, or be the cause of the trouble. So it opens the device
  anew, or talks to what has it open, and returns `:ok` only if the hardware is safe.

    * A handler outlives its process. It stays until a successor registers the same path or until
      its process is dead and its `disarm/1` has run without a failure. So an actuator that is
      down at that moment is made safe as well.
    * A handler of a process outside of the robot's tree stays as long as that process lives,
      however often the robot starts anew.
    * Who registers a path that is taken takes its place; no path has two handlers.
    * Those who register while the robot is `:disarming` belong to the next disarming: their
      hardware was never armed.
    * A handler may call the functions of this module. It gets `{:error, :already_disarming}` from
      `disarm/2`, and so on.

  ## When the robot ends

  The death of the root supervisor or of the topology supervisor, however it comes, is a disarming
  for an armed robot: each handler runs once. A robot that is stopped (`Supervisor.stop/1`, or
  with its application) is disarmed after its components have ended, and the stop waits for it.
  One that is not armed has nothing to be made safe: no handler runs.

  A robot that starts anew while the one before it is `:disarming` is not armed until that is
  over. An `:error` stays too, until `force_disarm/1`.

  What decides is a process for each robot outside the robot's tree (`BB.Safety.Warden`), so that
  no robot waits for another's handlers. All that it knows is in ETS: when it is killed, states
  and handlers stay, and its successor continues a disarming without calling a handler twice.

  ## When the application ends

  The end of the application `:ganglion`, however it comes, is a disarming for every armed robot,
  also for one that another application has started. Such a robot goes on, disarmed, and nobody
  arms it before the application has been started again. What serves safety stands outside of the
  application (`BB.Safety.Supervisor`), so that no bus, simulation or robot can take it down.

  ## What it cannot do

  Software stops with the machine that runs it. When the whole VM is killed or the power fails, no
  handler runs. An emergency stop that people rely on cuts the actuators' power by a circuit; this
  module is for everything before that.
  """

  alias BB.{Message, Path, PubSub}
  alias BB.Safety.{HardwareError, Record, Records, Round, Warden}

  @type state :: Record.state()
  @type disarm_error :: Round.error()

  @type arm_error ::
          :already_armed
          | :disarming
          | :in_error
          | :not_registered
          | :not_running
          | {:inhibited, [{Path.t(), reason :: term()}, ...]}

  @doc """
  Whether the robot is armed. `false` for one that is not known.

      iex> BB.Safety.armed?(NoRobot)
      false
  """
  @spec armed?(module()) :: boolean()
  def armed?(robot), do: Records.state(robot) == :armed

  @doc """
  The robot's state. `:disarmed` for one that is not known.

      iex> BB.Safety.state(NoRobot)
      :disarmed
  """
  @spec state(module()) :: state()
  def state(robot), do: Records.state(robot)

  @doc """
  The number of the robot's latest arming, 0 before the first: `{:ok, epoch}`, or `{:error,
  :not_registered}` for a robot that is not started.

  Each arming has a new one, greater than all before it. A command that carries the epoch in which
  it was thought out is recognised as old when the robot was disarmed and armed since.
  """
  @spec epoch(module()) :: {:ok, non_neg_integer()} | {:error, :not_registered}
  def epoch(robot) do
    with :error <- Records.epoch(robot), do: {:error, :not_registered}
  end

  @doc """
  Arms the robot. Errors:

    * `:already_armed`
    * `:disarming` - a disarming is under way
    * `:in_error` - a disarming failed; see `force_disarm/1`
    * `:not_registered` - the robot is not started
    * `:not_running` - the application `:ganglion` is not running; start it again
    * `{:inhibited, [{path, reason}]}` - something forbids it; see `inhibit/3`
  """
  @spec arm(module()) :: :ok | {:error, arm_error()}
  def arm(robot), do: Warden.arm(robot)

  @doc """
  Disarms the robot: calls all handlers at once, and returns when the last one is done or
  `timeout` milliseconds have passed.

  `:ok` says that every handler returned `:ok`. Errors:

    * `:already_disarmed`, `:already_disarming`, `:already_in_error` - nothing was done
    * `:not_registered` - the robot is not started
    * `{:disarm_failed, [{path, error}]}` - the hardware of those paths may not be safe. The robot
      is in `:error`. An error is
      * `{:returned_error, reason}` - the handler returned `{:error, reason}`; for anything else but `:ok` the reason is
        `{:bad_return_value, term}`
      * `{:exception, message}` - it raised
      * `{:throw, value}` or `{:exit, reason}` - it threw, exited or was killed
      * `{:timeout, ms}` - it was not done in time, and was killed

  Options: `timeout:` in milliseconds, #{Warden.default_timeout_ms()} when not given.
  """
  @spec disarm(module(), timeout: pos_integer()) ::
          :ok
          | {:error,
             :already_disarmed
             | :already_disarming
             | :already_in_error
             | :not_registered
             | {:disarm_failed, [{Path.t(), disarm_error()}, ...]}}
  def disarm(robot, opts \\ []), do: Warden.disarm(robot, timeout_ms!(opts))

  @doc """
  Takes a robot out of `:error` to `:disarmed` without calling any handler. For a person who has
  seen that the hardware is safe.

  Errors: `:not_in_error`, `:not_registered`.
  """
  @spec force_disarm(module()) :: :ok | {:error, :not_in_error | :not_registered}
  def force_disarm(robot), do: Warden.force_disarm(robot)

  @doc """
  Registers `module.disarm/1` for a path of a robot, in the place of what is registered for that
  path.

  Components do not call this: their server does. It is for hardware that no component stands for.

  Options: `robot:` and `path:`, both required, and `opts:`, what the handler is called with
  (`[]`).

  A robot that is not started becomes known by this, with the calling process in the place of its
  root.
  """
  @spec register(module(), robot: module(), path: Path.t(), opts: keyword()) :: :ok
  def register(module, options) do
    options = Keyword.validate!(options, [:robot, :path, opts: []])
    robot = robot!(options[:robot])
    path = Path.validate!(options[:path])
    handler!(module)
    known!(robot)
    Records.register(robot, path, self(), module, options[:opts])

    # Its robot may have ended meanwhile.
    known!(robot)
  end

  defp known!(robot),
    do: if(Records.known?(robot), do: :ok, else: Warden.watch(robot, :component))

  @doc """
  Forbids arming, for as long as `allow/2` is not called for the same path, whatever dies
  meanwhile. `reason` is told to those who try.

  For what watches over the robot: an emergency stop that is pressed, a lid that is open. It does
  not disarm a robot that is armed:

      BB.Safety.inhibit(robot, path, :pressed)
      BB.Safety.disarm(robot)

  In this order nobody can arm it in between. See also `vouch/2`.
  """
  @spec inhibit(module(), Path.t(), reason :: term()) :: :ok
  def inhibit(robot, path, reason) do
    Records.inhibit(robot!(robot), Path.validate!(path), reason)
    :ok
  end

  @doc "Takes back what `inhibit/3` forbade for this path. `:ok` also when there was nothing."
  @spec allow(module(), Path.t()) :: :ok
  def allow(robot, path) do
    Records.allow(robot!(robot), Path.validate!(path))
    :ok
  end

  @doc """
  Takes back what `inhibit/3` forbade for this path, for as long as the calling process lives.

  When that process ends, however it does, the path forbids arming again, with the reason
  `:unattended`, and a robot that is armed is disarmed at once. There is no moment in between. So
  who watches over a robot calls this instead of `allow/2`: nobody arms the robot, and it does not
  stay armed, while nobody watches. Its successor vouches anew. `allow/2` ends it.

  It makes no difference whether the process belongs to the robot, whether it vouched before the
  robot was started, and how often the robot has been started since.

      BB.Safety.inhibit(robot, path, :starting)
      …
      BB.Safety.vouch(robot, path)

  A robot that is not started becomes known by this, with the calling process in the place of its
  root.
  """
  @spec vouch(module(), Path.t()) :: :ok
  def vouch(robot, path), do: Warden.vouch(robot!(robot), Path.validate!(path))

  @doc "What forbids arming: `[{path, reason}]`."
  @spec inhibitions(module()) :: [{Path.t(), reason :: term()}]
  def inhibitions(robot), do: Records.inhibitions(robot!(robot))

  @doc """
  Publishes that hardware is at fault, as `BB.Safety.HardwareError` on `[:safety, :error]`. What
  follows from it is the subscribers' choice.

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
           do:
             raise(ArgumentError, "a handler is a module with disarm/1, got: #{inspect(module)}")
  end

  defp robot!(robot) when is_atom(robot) and robot != nil, do: robot
  defp robot!(robot), do: raise(ArgumentError, "a robot is a module, got: #{inspect(robot)}")

  defp timeout_ms!(opts) do
    case Keyword.validate!(opts, timeout: Warden.default_timeout_ms())[:timeout] do
      timeout_ms when is_integer(timeout_ms) and timeout_ms > 0 ->
        timeout_ms

      other ->
        raise ArgumentError, "timeout: of disarm is in milliseconds, got: #{inspect(other)}"
    end
  end
end

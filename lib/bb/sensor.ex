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

  and in the robot: `sensor :thermometer, {MyRobot.Thermometer, bus: "i2c-1"}`.

  ## Options

  Say what options the driver takes, in the format of `BB.Options`, either by `use BB.Sensor, options_schema: […]` or by a
  function `options_schema/0`, not both; without a schema it takes none. Options are checked, and defaults filled in, before
  `init/1`; wrong ones fail the robot's start. Beside them `init/1` gets

    * `opts[:bb]` - `%{robot: robot_module, path: path}`, the path as `[:base_link, :imu]`
    * `opts[:sensor_profile]` - `BB.Sensor.SensorProfile`

  ## When things go wrong

  A device that does not answer is no reason to crash: return `{:stop, reason}` from `init/1`, or `{:stop, reason, state}` from
  a later callback, with a reason that a person can act on. The sensor then goes down alone and is started again, at first
  within 100 ms, then less often (`BB.Component.Backoff`), until it is up. A crash is handled in the same way, with OTP's report
  in the log. A process that the driver links to itself takes it down when it fails.

  Each change is published as `BB.Message.Sensor.Status` on `[:sensor_status | path]`, set or cleared as the OTP alarm
  `{BB.Sensor, robot, path}`, and visible in `health/1`.

  Never publish an old reading as a new one. When the device stops answering, publish nothing; with `max_silence` in the
  robot's declaration the sensor is then `:stale`.
  """

  @behaviour BB.Component

  alias BB.{Message, PubSub}
  alias BB.Component.{Callbacks, Health, Reason}
  alias BB.Message.Sensor.JointState
  alias BB.Sensor.SensorProfile

  @type bb :: %{robot: module(), path: [atom(), ...]}
  @type next :: timeout() | :hibernate | {:continue, term()}

  @doc "The schema of the driver's options."
  @callback options_schema() :: BB.Options.schema() | BB.Options.t()

  @doc """
  Opens the device. `{:stop, reason}` says that it is absent, and is asked again; `:ignore` turns the sensor off for good.
  """
  @callback init(opts :: keyword()) ::
              {:ok, state :: term()}
              | {:ok, state :: term(), next()}
              | {:stop, reason :: term()}
              | :ignore

  @doc """
  Makes the hardware safe. Gets the options of `init/1` and must work without the process, which may be dead.
  """
  @callback disarm(opts :: keyword()) :: :ok | {:error, term()}

  @doc "Takes on new options, checked as those of `init/1`. By default they change nothing."
  @callback handle_options(new_opts :: keyword(), state :: term()) ::
              {:ok, state :: term()} | {:stop, reason :: term()}

  @doc "As in `GenServer`. By default the reply is `{:error, :not_implemented}`."
  @callback handle_call(request :: term(), GenServer.from(), state :: term()) ::
              {:reply, reply :: term(), new_state :: term()}
              | {:reply, reply :: term(), new_state :: term(), next()}
              | {:noreply, new_state :: term()}
              | {:noreply, new_state :: term(), next()}
              | {:stop, reason :: term(), reply :: term(), new_state :: term()}
              | {:stop, reason :: term(), new_state :: term()}

  @doc "As in `GenServer`. By default the request is ignored."
  @callback handle_cast(request :: term(), state :: term()) :: noreply()

  @doc "As in `GenServer`. By default the message is ignored."
  @callback handle_info(message :: term(), state :: term()) :: noreply()

  @doc "As in `GenServer`. By default nothing is done."
  @callback handle_continue(argument :: term(), state :: term()) :: noreply()

  @doc "As in `GenServer`; also runs when the robot is stopped."
  @callback terminate(reason :: term(), state :: term()) :: term()

  @doc """
  A reason of this driver's in a sentence that says what to look at: "no answer at 0x68 on i2c-1: check wiring and power". Reasons that it
  has no clause for are shown as terms.
  """
  @callback explain(reason :: term()) :: String.t()

  @optional_callbacks disarm: 1, explain: 1

  @type noreply ::
          {:noreply, new_state :: term()}
          | {:noreply, new_state :: term(), next()}
          | {:stop, reason :: term(), new_state :: term()}

  @doc false
  defmacro __using__(opts), do: Callbacks.code(__MODULE__, opts)

  @impl BB.Component
  def component_kind, do: :sensor

  @impl BB.Component
  def component_options(robot, name), do: [sensor_profile: profile(robot, name)]

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
      "it has published nothing for 250 ms"
  """
  @spec explain(module(), reason :: term()) :: String.t()
  def explain(module, reason), do: Reason.words(reason, module)

  @doc "Publishes a sensor's message on its path, `[:sensor | path]`."
  @spec publish(bb(), Message.t()) :: :ok
  def publish(%{robot: robot, path: path}, message),
    do: PubSub.publish(robot, [:sensor | path], message)

  @doc """
  Publishes a `BB.Message.Sensor.JointState` on `[:sensor | path]`.

  `opts` are its fields; `names` is `[frame_id]` when not given. The frame_id is the joint's name where the sensor is attached
  to a joint, else the sensor's. Fields that are wrong raise `BB.Options.ValidationError`.
  """
  @spec publish_joint_state(module(), [atom(), ...], keyword()) :: :ok
  def publish_joint_state(robot, path, opts) do
    name = List.last(path)
    frame_id = profile(robot, name).joint_name || name
    message = Message.new!(JointState, frame_id, Keyword.put_new(opts, :names, [frame_id]))
    publish(%{robot: robot, path: path}, message)
  end

  defp profile(robot, name) do
    case sensor(robot, name) do
      %{attached_to: {:joint, joint}, transmission: transmission} ->
        %SensorProfile{joint_name: joint, transmission: transmission}

      _ ->
        %SensorProfile{}
    end
  end

  defp sensor(robot, name) do
    if Code.ensure_loaded?(robot) and function_exported?(robot, :robot, 0),
      do: robot.robot().sensors[name]
  end
end

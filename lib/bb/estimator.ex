defmodule BB.Estimator do
  @moduledoc """
  The behaviour of an estimator: a component that makes messages of the messages of sensors, such
  as a filter that finds the orientation in the readings of an IMU. A robot's supervisors run it
  in a process, as they run a sensor (`BB.Component.Server`).

  Implement it for what can be computed from sensors and is not a device of its own.

      defmodule MyRobot.Smooth do
        use BB.Estimator, options_schema: [weight: [type: :float, default: 0.1]]

        alias BB.Message.Sensor.Range

        @impl BB.Estimator
        def init(opts), do: {:ok, %{weight: opts[:weight], frame: frame(opts), range: nil}}

        @impl BB.Estimator
        def handle_input(%BB.Message{payload: payload}, state) do
          range = mix(state.range, payload.range, state.weight)
          {:ok, message} = Range.new(state.frame, Map.to_list(%{payload | range: range}))
          {:reply, [out: message], %{state | range: range}}
        end
      end

  It stands in a sensor, whose messages it is given, or in a link, with inputs:

      link :base_link do
        sensor :distance, {BB.Sensor.TfLuna, bus: "i2c-1"} do
          estimator :smooth, {MyRobot.Smooth, weight: 0.2}
        end

        estimator :pose, MyRobot.Fusion do
          input :imu, [:sensor, :base_link, :imu], driver?: true
          input :distance, [:sensor, :base_link, :distance, :smooth]
          sync_tolerance ~u(20 millisecond)
          lost_after ~u(1 second)
          on_lost :stand_still
        end
      end

  | | in a sensor | in a link |
  |---|---|---|
  | path, topic of the output `:out` | `[:sensor, …, sensor, name]` | `[:estimator, …, link, name]` |
  | inputs | the messages of the sensor | at least one `input` |
  | `target_frame` | the name of the sensor | the name of the link |

  `init/1` receives the options, checked and with the values of parameters as those of a sensor,
  `opts[:bb]` with the path above, and `opts[:estimator_context]` (`BB.Estimator.Context`).

  ## Inputs

  A message is an input when its topic is exactly the path of an `input`; all others go to
  `handle_info/2`. With several inputs the one with `driver?: true` triggers the estimator. It is
  given `%{input_name => message}` with the newest message of each. When one is missing, or its
  `monotonic_time` differs from the driver's by more than `sync_tolerance`, the input is dropped.

  ## Outputs

  `c:handle_input/2`, `handle_cast/2`, `handle_info/2` and `handle_continue/2` return
  `{:reply, [{output, message}], state}`, or what a `GenServer` returns; `handle_call/3` returns
  `{:reply, reply, [{output, message}], state}`. The output `:out` is always there. Others are
  declared: `output :bias, path: [:estimator, :imu_bias]`.

  ## Health

  An estimator is `:healthy`, `:degraded` after an input that took longer than `latency_budget` or
  was dropped, and `:lost` after `lost_after` without an input. It recovers after `recover_after`
  good inputs in a row (`BB.Estimator.Health`). Each change executes the command that
  `on_degraded`, `on_lost` or `on_recovered` names, with the goal
  `%{estimator, reason, source_path, previous_state, new_state}`.

  Telemetry events are `[:bb, :estimator, :input]`, `:output`, `:dropped` and `:transition` with
  `%{count: 1}`, and `:latency` with `duration` and `input_to_output` in nanoseconds. Their
  metadata has `robot` and `estimator`.
  """

  @behaviour BB.Component

  alias BB.Component.{Callbacks, Health, Reason}
  alias BB.Estimator.Server
  alias BB.Message

  @type bb :: %{robot: module(), path: [atom(), ...]}
  @type next :: timeout() | :hibernate | {:continue, term()}
  @type outputs :: [{atom(), Message.t()}]

  @type noreply ::
          {:noreply, new_state :: term()}
          | {:noreply, new_state :: term(), next()}
          | {:reply, outputs(), new_state :: term()}
          | {:reply, outputs(), new_state :: term(), next()}
          | {:stop, reason :: term(), new_state :: term()}

  @doc "Returns the schema of the module's options."
  @callback options_schema() :: BB.Options.schema() | BB.Options.t()

  @doc "Makes the state of the estimator."
  @callback init(opts :: keyword()) ::
              {:ok, state :: term()}
              | {:ok, state :: term(), next()}
              | {:stop, reason :: term()}
              | :ignore

  @doc "Handles an input: a message, or the messages of several inputs by their names."
  @callback handle_input(Message.t() | %{atom() => Message.t()}, state :: term()) :: noreply()

  @doc "Applies new options after a parameter to which they refer has changed."
  @callback handle_options(new_opts :: keyword(), state :: term()) ::
              {:ok, state :: term()} | {:stop, reason :: term()}

  @doc "Handles a call, as in `GenServer`. By default it replies `{:error, :not_implemented}`."
  @callback handle_call(request :: term(), GenServer.from(), state :: term()) ::
              {:reply, reply :: term(), new_state :: term()}
              | {:reply, reply :: term(), outputs(), new_state :: term()}
              | {:reply, reply :: term(), new_state :: term(), next()}
              | {:reply, reply :: term(), outputs(), new_state :: term(), next()}
              | {:noreply, new_state :: term()}
              | {:noreply, new_state :: term(), next()}
              | {:stop, reason :: term(), reply :: term(), new_state :: term()}
              | {:stop, reason :: term(), new_state :: term()}

  @doc "Handles a cast, as in `GenServer`. By default it ignores the request."
  @callback handle_cast(request :: term(), state :: term()) :: noreply()

  @doc "Handles a message that is no input. By default it ignores the message."
  @callback handle_info(message :: term(), state :: term()) :: noreply()

  @doc "Continues after another callback, as in `GenServer`. By default it does nothing."
  @callback handle_continue(argument :: term(), state :: term()) :: noreply()

  @doc "Cleans up, as in `GenServer`. It also runs when the robot is stopped."
  @callback terminate(reason :: term(), state :: term()) :: term()

  @doc "Formats a reason of this module as a sentence that says what to do."
  @callback explain(reason :: term()) :: String.t()

  @optional_callbacks explain: 1

  @doc false
  defmacro __using__(opts), do: Callbacks.code(__MODULE__, opts)

  @doc false
  @impl BB.Component
  def component_kind, do: :estimator

  @doc false
  @impl BB.Component
  def component_options(_joint, _transmission), do: []

  @doc false
  @impl BB.Component
  defdelegate component_apply(module, callback, arguments), to: Server, as: :call

  @doc """
  Returns the health of the processes of the robot's estimators, as `BB.Sensor.health/1` does of
  its sensors.
  """
  @spec health(module()) :: [Health.row()]
  def health(robot), do: Health.list(robot, __MODULE__)

  @doc "Formats the reason for which an estimator is down, as `BB.Sensor.explain/2` does."
  @spec explain(module(), reason :: term()) :: String.t()
  def explain(module, reason), do: Reason.format(reason, module)
end

defmodule BB.Component do
  @moduledoc """
  A component of a robot as it is declared: a sensor, an actuator, a controller or an estimator.

  `MyRobot.robot().components` lists the components of a robot as these structs. The struct is for
  code that reads a robot's declaration; a driver implements `BB.Sensor`, `BB.Actuator`,
  `BB.Controller` or `BB.Estimator`.

      iex> component = %BB.Component{
      ...>   name: :imu,
      ...>   kind: BB.Sensor,
      ...>   module: BB.Sensor.Mpu6050,
      ...>   options: [bus: "i2c-1"],
      ...>   path: [:base_link, :imu]
      ...> }
      iex> BB.Component.data_path(component)
      [:sensor, :base_link, :imu]

  ## Fields

    * `:name` - the name, unique among all components of the robot
    * `:kind` - the behaviour that the module implements: `BB.Sensor`, `BB.Actuator`,
      `BB.Controller` or `BB.Estimator`
    * `:module`, `:options` - the callback module and its options as declared
    * `:path` - the component's place: `[name]` on the robot itself, `[link…, name]` on a link,
      `[link…, joint, name]` on a joint, and for an estimator the same or `[…, sensor, name]` in a
      sensor
    * `:attached_to` - `nil` (the robot), `{:link, name}` or `{:joint, name}`
    * `:transmission` - the gears between the component and its joint (`BB.Transmission`), or
      `nil`
    * `:required` - whether the robot is useless without the component
    * `:retain` - whether the pubsub keeps the component's last message for late subscribers
    * `:simulation` - whether a simulated robot omits it, mocks it or starts it itself; for
      controllers
    * `:estimator` - the topics, times and commands of an estimator, `nil` for other kinds
    * `:max_silence_ns` - the longest time between two messages, or `nil` for no limit

  ## Kinds

  All components run in the same server (`BB.Component.Server`) under the same keeper
  (`BB.Component.Keeper`). A kind differs from the others by the callbacks of this behaviour.
  `BB.Component.Kind` makes the module of a kind.
  """

  @enforce_keys [:name, :kind, :module, :options, :path]
  defstruct [
    :name,
    :kind,
    :module,
    :options,
    :path,
    :attached_to,
    :transmission,
    :max_silence_ns,
    :estimator,
    required: false,
    retain: false,
    simulation: :start
  ]

  @type attachment :: nil | {:link, atom()} | {:joint, atom()}

  @typedoc "An input of an estimator: its topic, and whether it triggers the estimator."
  @type input :: %{name: atom(), path: [atom()], driver?: boolean()}

  @typedoc "What is declared of an estimator alone."
  @type estimator :: %{
          topic: [atom(), ...],
          target_frame: atom(),
          inputs: [input(), ...],
          outputs: %{atom() => [atom()]},
          sync_tolerance_ns: non_neg_integer() | nil,
          latency_budget_ns: non_neg_integer() | nil,
          lost_after_ns: non_neg_integer() | nil,
          recover_after: pos_integer(),
          on_degraded: atom() | nil,
          on_lost: atom() | nil,
          on_recovered: atom() | nil
        }

  @type t :: %__MODULE__{
          name: atom(),
          kind: module(),
          module: module(),
          options: keyword(),
          path: [atom(), ...],
          attached_to: attachment(),
          transmission: BB.Transmission.declared() | nil,
          max_silence_ns: pos_integer() | nil,
          estimator: estimator() | nil,
          required: boolean(),
          retain: boolean(),
          simulation: :omit | :mock | :start
        }

  @doc """
  Returns the kind's word, such as `:sensor`.

  The paths on which components of the kind publish begin with it.
  """
  @callback component_kind() :: atom()

  @typedoc """
  The joint of a component: its name, and its limits in SI units as `BB.Robot.Joint` has them.
  """
  @type joint :: %{name: atom(), limits: BB.Robot.Limits.t() | nil}

  @doc """
  Returns the options that the kind adds to a component's own options, such as
  `[sensor_profile: …]`.

  The joint and the transmission are `nil` where the component has none.
  """
  @callback component_options(joint() | nil, BB.Transmission.t() | nil) :: keyword()

  @doc """
  Prepares the process of a component before its `init/1` is called with `options`.

  The result is passed to `c:component_request/4`. Kinds without this callback leave all requests
  to the callback module.
  """
  @callback component_start(module(), options :: keyword()) :: term()

  @typedoc "How a request came: `GenServer.call/3`, `GenServer.cast/2`, or any other message."
  @type transport :: :call | :cast | :message

  @doc """
  Decides about a request, with the result of `c:component_start/2` and the present options.

  The decisions:

    * `:pass` - the callback of the transport handles it, `handle_call/3` and the like
    * `{:command, message}` - `handle_command/2` handles this message
    * `{:answer, reply}` - a call gets this reply; any other request is dropped
  """
  @callback component_request(transport(), request :: term(), started :: term(), keyword()) ::
              :pass | {:command, BB.Message.t()} | {:answer, term()}

  @doc """
  Calls a callback of a module, for a kind that does something before and after it.

  Kinds without this callback do not.
  """
  @callback component_apply(module(), callback :: atom(), arguments :: [term()]) :: term()

  @optional_callbacks component_start: 2, component_request: 4, component_apply: 3

  @doc "Returns whether a loaded module declares a behaviour."
  @spec implements?(module(), module()) :: boolean()
  def implements?(module, behaviour) do
    attributes = module.module_info(:attributes)
    Enum.any?(attributes, fn {key, value} -> key == :behaviour and behaviour in value end)
  end

  @doc "Returns the path on which a component publishes."
  @spec data_path(t()) :: [atom()]
  def data_path(%__MODULE__{estimator: %{topic: topic}}), do: topic
  def data_path(%__MODULE__{kind: kind, path: path}), do: [kind.component_kind() | path]

  @doc "Returns the path on which the changes of a component's status are published."
  @spec status_path(t()) :: [atom()]
  def status_path(%__MODULE__{kind: kind, path: path}),
    do: [:"#{kind.component_kind()}_status" | path]
end

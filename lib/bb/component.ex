defmodule BB.Component do
  @moduledoc """
  A component of a robot, as declared: a sensor, an actuator or a controller.

  All kinds of components run in one server (`BB.Component.Server`) under one keeper (`BB.Component.Keeper`). What differs
  between kinds is told by the kind's behaviour module, `BB.Sensor` for sensors, through the callbacks of this behaviour;
  `BB.Component.Kind` makes such modules.

    * `:name` - unique among all components of the robot
    * `:kind` - the behaviour that its module implements
    * `:module`, `:options` - the callback module and its options as declared
    * `:path` - where it is: `[name]` on the robot itself, `[link…, name]` on a link, `[link…, joint, name]` on a joint
    * `:attached_to` - `nil` (the robot), `{:link, name}` or `{:joint, name}`
    * `:transmission` - what is between it and its joint (`BB.Transmission`), `nil` when nothing is
    * `:required` - whether the robot is of no use without it
    * `:retain` - whether its last message is worth keeping for those who subscribe late
    * `:max_silence_ns` - the longest time between two of its messages, `nil` when it may be silent
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
    required: false,
    retain: false
  ]

  @type attachment :: nil | {:link, atom()} | {:joint, atom()}

  @type t :: %__MODULE__{
          name: atom(),
          kind: module(),
          module: module(),
          options: keyword(),
          path: [atom(), ...],
          attached_to: attachment(),
          transmission: BB.Transmission.declared() | nil,
          max_silence_ns: pos_integer() | nil,
          required: boolean(),
          retain: boolean()
        }

  @doc "The kind's word, also the head of the paths on which its components publish: `:sensor`."
  @callback component_kind() :: atom()

  @doc """
  Options that components of this kind get beside their own and `:bb`, made from the joint's name and the transmission, each
  `nil` where there is none: `[sensor_profile: …]`.
  """
  @callback component_options(joint_name :: atom() | nil, BB.Transmission.t() | nil) :: keyword()

  @doc "Whether a module that is loaded declares a behaviour."
  @spec implements?(module(), module()) :: boolean()
  def implements?(module, behaviour) do
    attributes = module.module_info(:attributes)
    Enum.any?(attributes, fn {key, value} -> key == :behaviour and behaviour in value end)
  end

  @doc "The path on which a component publishes."
  @spec data_path(t()) :: [atom()]
  def data_path(%__MODULE__{kind: kind, path: path}), do: [kind.component_kind() | path]

  @doc "The path on which changes of its state are published."
  @spec status_path(t()) :: [atom()]
  def status_path(%__MODULE__{kind: kind, path: path}),
    do: [:"#{kind.component_kind()}_status" | path]
end

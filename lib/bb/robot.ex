defmodule BB.Robot do
  @moduledoc """
  A robot as its module declares it: data, made when the module compiles. `R.robot()` returns it.

    * `:name` - the robot's module
    * `:settings` - what stands in `settings`: `%{name: :my_robot}`
    * `:root_link` - the name of the root link, `nil` without a topology
    * `:links`, `:joints` - by name: `BB.Robot.Link`, `BB.Robot.Joint`
    * `:sensors` - by name: `%{name: name, attached_to: nil | {:link, name} | {:joint, name}, transmission: t}`; t is
      a `BB.Transmission` or `nil`
    * `:actuators`, `:controllers` - by name, as sensors
    * `:parameters` - their definitions in the order of the declaration: `BB.Parameter.Definition`
    * `:components` - all components in the order of their declaration, what the supervisors start: `BB.Component`
    * `:simulation` - what hangs on the simulated buses, as `BB.Bus.Sim` and `BB.Bus.Sim.Lines` take it:
      `%{i2c: [{"i2c-1", clock_hz: 400_000, devices: [{0x68, device}]}], gpio: […]}`
    * `:param_subscriptions` - which fields follow which parameters: for each path of a parameter the places, as
      `[:sensors, :imu, :rate]` for an option, `[:sensors, :encoder, :transmission, :offset]`,
      `[:joints, :shoulder, :limit, :upper]`

  A field that follows a parameter has a `BB.Parameter.Reference` here; `BB.Parameter.resolve/2` gives the values of now.
  """

  alias BB.Component
  alias BB.Robot.{Joint, Link}

  @enforce_keys [:name]
  defstruct [
    :name,
    :root_link,
    settings: %{},
    links: %{},
    joints: %{},
    sensors: %{},
    actuators: %{},
    controllers: %{},
    parameters: [],
    components: [],
    simulation: %{i2c: [], gpio: []},
    param_subscriptions: %{}
  ]

  @type attached :: %{
          name: atom(),
          attached_to: Component.attachment(),
          transmission: BB.Transmission.declared() | nil
        }

  @type t :: %__MODULE__{
          name: module(),
          root_link: atom() | nil,
          settings: %{atom() => term()},
          links: %{atom() => Link.t()},
          joints: %{atom() => Joint.t()},
          sensors: %{atom() => attached()},
          actuators: %{atom() => attached()},
          controllers: %{atom() => attached()},
          parameters: [BB.Parameter.Definition.t()],
          components: [Component.t()],
          simulation: %{i2c: [{String.t(), keyword()}], gpio: [{String.t(), keyword()}]},
          param_subscriptions: %{BB.Parameter.path() => [[atom()]]}
        }

  @doc "The link of that name: `{:ok, link}` or `:error`."
  @spec fetch_link(t(), atom()) :: {:ok, Link.t()} | :error
  def fetch_link(%__MODULE__{links: links}, name), do: Map.fetch(links, name)

  @doc "The joint of that name: `{:ok, joint}` or `:error`."
  @spec fetch_joint(t(), atom()) :: {:ok, Joint.t()} | :error
  def fetch_joint(%__MODULE__{joints: joints}, name), do: Map.fetch(joints, name)

  @doc "The component of that name: `{:ok, component}` or `:error`."
  @spec fetch_component(t(), atom()) :: {:ok, Component.t()} | :error
  def fetch_component(%__MODULE__{components: components}, name) do
    case Enum.find(components, &(&1.name == name)) do
      nil -> :error
      component -> {:ok, component}
    end
  end

  @doc "The components on the robot itself (`nil`), on a link or on a joint, in the order of their declaration."
  @spec components_on(t(), Component.attachment()) :: [Component.t()]
  def components_on(%__MODULE__{components: components}, place),
    do: Enum.filter(components, &(&1.attached_to == place))
end

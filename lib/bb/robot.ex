defmodule BB.Robot do
  @moduledoc """
  The declaration of a robot as data. The compiler makes it from the robot's module, and
  `MyRobot.robot()` returns it. Use it to list a robot's parts.

      Map.keys(MyRobot.robot().sensors)
      {:ok, shoulder} = BB.Robot.fetch_joint(MyRobot.robot(), :shoulder)

  Its fields:

    * `:name` - the robot's module
    * `:settings` - the fields of `settings`, such as `%{name: :my_robot}`
    * `:root_link` - the name of the root link, `nil` without a topology
    * `:links`, `:joints` - by name: `BB.Robot.Link`, `BB.Robot.Joint`
    * `:sensors` - by name, a map with `:name`, `:attached_to` (`nil`, `{:link, name}` or
      `{:joint, name}`) and `:transmission` (a `BB.Transmission` or `nil`)
    * `:actuators`, `:controllers` - by name, as sensors
    * `:parameters` - their definitions in the order of the declaration, each a
      `BB.Parameter.Definition`
    * `:components` - all components in the order of the declaration, each a `BB.Component`; the
      supervisors start them
    * `:simulation` - the simulated buses and their devices, as `BB.Bus.Sim` and
      `BB.Bus.Sim.Lines` take them:
      `%{i2c: [{"i2c-1", clock_hz: 400_000, devices: [{0x68, device}]}], gpio: […]}`
    * `:param_subscriptions` - the fields that follow each parameter, by the path of the
      parameter: `[:sensors, :imu, :rate]` for an option,
      `[:sensors, :encoder, :transmission, :offset]`, `[:joints, :shoulder, :limit, :upper]`

  A field that follows a parameter is a `BB.Parameter.Reference`; `BB.Parameter.resolve/2`
  replaces references by the current values.
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

  @doc "Fetches a link by its name: `{:ok, link}` or `:error`."
  @spec fetch_link(t(), atom()) :: {:ok, Link.t()} | :error
  def fetch_link(%__MODULE__{links: links}, name), do: Map.fetch(links, name)

  @doc "Fetches a joint by its name: `{:ok, joint}` or `:error`."
  @spec fetch_joint(t(), atom()) :: {:ok, Joint.t()} | :error
  def fetch_joint(%__MODULE__{joints: joints}, name), do: Map.fetch(joints, name)

  @doc "Fetches a component by its name: `{:ok, component}` or `:error`."
  @spec fetch_component(t(), atom()) :: {:ok, Component.t()} | :error
  def fetch_component(%__MODULE__{components: components}, name) do
    case Enum.find(components, &(&1.name == name)) do
      nil -> :error
      component -> {:ok, component}
    end
  end

  @doc """
  Returns the components on the robot itself (`nil`), on a link or on a joint, in the order of the
  declaration.
  """
  @spec components_on(t(), Component.attachment()) :: [Component.t()]
  def components_on(%__MODULE__{components: components}, place),
    do: Enum.filter(components, &(&1.attached_to == place))
end

defmodule BB.Component.Resolution do
  @moduledoc """
  Turns a component's declared options into the options of its callbacks.

  `BB.Component.Server` resolves the options of its component: it replaces the references to
  parameters by their values, checks the options against the module's schema, and adds the options
  of the component's place. The module is pure.

      iex> import BB.Parameter.Reference
      iex> alias BB.Component.Resolution
      iex> bb = %{robot: MyRobot, path: [:base_link, :imu]}
      iex> options = [bus: "i2c-1", rate: param([:imu, :rate])]
      iex> resolution = Resolution.new(BB.Sensor, BB.Sensor.Mpu6050, bb, options)
      iex> {:ok, options} = Resolution.options(resolution, %{[:imu, :rate] => 50})
      iex> options[:rate]
      50
  """

  alias BB.{Component, Robot, Transmission}
  alias BB.Component.OptionsSchema
  alias BB.Options.ValidationError
  alias BB.Parameter.Reference

  @enforce_keys [:module, :kind, :bb, :options]
  defstruct [:module, :kind, :bb, :options, :joint_name, :limits, :transmission]

  @type values :: %{BB.Parameter.path() => term()}

  @type t :: %__MODULE__{
          module: module(),
          kind: module(),
          bb: %{robot: module(), path: [atom(), ...]},
          options: keyword(),
          joint_name: atom() | nil,
          limits: Robot.Limits.declared() | nil,
          transmission: Transmission.declared() | nil
        }

  @doc """
  Returns the resolution for a module at `bb.path` of the robot.

  In a driver's test the robot may have no declaration.
  """
  @spec new(module(), module(), map(), keyword()) :: t()
  def new(kind, module, bb, options) do
    resolution = %__MODULE__{kind: kind, module: module, bb: bb, options: options}

    with true <- Code.ensure_loaded?(bb.robot) and function_exported?(bb.robot, :robot, 0),
         {:ok, component} <- Robot.fetch_component(bb.robot.robot(), List.last(bb.path)) do
      put_place(resolution, bb.robot.robot(), component)
    else
      _ -> resolution
    end
  end

  @doc "Returns the resolution for a component that a robot declares."
  @spec of(module(), Component.t()) :: t()
  def of(robot, %Component{} = component) do
    bb = %{robot: robot, path: component.path}
    %Component{kind: kind, module: module, options: options} = component
    resolution = %__MODULE__{kind: kind, module: module, bb: bb, options: options}
    put_place(resolution, robot.robot(), component)
  end

  @doc "Returns the paths of the parameters to which the options refer."
  @spec paths(t()) :: [BB.Parameter.path()]
  def paths(%__MODULE__{} = resolution) do
    %{options: options, transmission: transmission, limits: limits} = resolution
    Enum.uniq(Enum.flat_map([options, transmission, limits], &Reference.paths/1))
  end

  @doc """
  Returns the options for `init/1` and `handle_options/2`, with these values of the parameters.

  The `keys_path` of an error begins with the component's path, so that its message ends in
  ` (in options [:base_link, :imu])`.
  """
  @spec options(t(), values()) :: {:ok, keyword()} | {:error, ValidationError.t()}
  def options(%__MODULE__{bb: bb} = resolution, values) do
    value = &Map.fetch!(values, &1)
    given = Reference.resolve(resolution.options, value)

    with {:ok, options} <- validate(resolution, given),
         {:ok, transmission} <- transmission(resolution, value) do
      own = resolution.kind.component_options(joint(resolution, value), transmission)
      {:ok, [bb: bb] ++ own ++ options}
    end
  end

  defp validate(%{module: module, bb: bb}, given) do
    with {:error, %ValidationError{} = error} <- OptionsSchema.validate(module, given, []),
         do: {:error, %{error | keys_path: bb.path ++ error.keys_path}}
  end

  defp joint(%{joint_name: nil}, _value), do: nil

  defp joint(%{joint_name: name, limits: limits}, value),
    do: %{name: name, limits: Robot.Limits.resolve(limits, value)}

  defp transmission(%{transmission: declared, bb: bb}, value) do
    with {:error, error} <- Transmission.resolve(declared, value),
         do: {:error, %{error | keys_path: bb.path ++ error.keys_path}}
  end

  defp put_place(resolution, robot, component) do
    resolution = %{resolution | transmission: component.transmission}

    case component.attached_to do
      {:joint, joint} -> put_joint(resolution, robot, joint)
      _elsewhere -> resolution
    end
  end

  # Only actuators need the limits of their joint, and follow the parameters in them.
  defp put_joint(%{kind: kind} = resolution, robot, joint) do
    limits = if kind.component_kind() == :actuator, do: Robot.Limits.declared(robot, joint)
    %{resolution | joint_name: joint, limits: limits}
  end
end

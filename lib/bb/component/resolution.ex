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

  alias BB.{Component, Options, Robot, Transmission}
  alias BB.Options.ValidationError
  alias BB.Parameter.Reference

  @enforce_keys [:module, :kind, :bb, :options]
  defstruct [:module, :kind, :bb, :options, :joint_name, :transmission]

  @type values :: %{BB.Parameter.path() => term()}

  @type t :: %__MODULE__{
          module: module(),
          kind: module(),
          bb: %{robot: module(), path: [atom(), ...]},
          options: keyword(),
          joint_name: atom() | nil,
          transmission: Transmission.declared() | nil
        }

  @doc """
  Returns the resolution for a module at `bb.path` of the robot.

  In a driver's test the robot may have no declaration.
  """
  @spec new(module(), module(), map(), keyword()) :: t()
  def new(kind, module, bb, options) do
    put_place(
      %__MODULE__{kind: kind, module: module, bb: bb, options: options},
      fetch_declared(bb.robot, List.last(bb.path))
    )
  end

  @doc "Returns the resolution for a component that a robot declares."
  @spec of(module(), Component.t()) :: t()
  def of(robot, %Component{} = component) do
    bb = %{robot: robot, path: component.path}
    %Component{kind: kind, module: module, options: options} = component
    put_place(%__MODULE__{kind: kind, module: module, bb: bb, options: options}, component)
  end

  @doc "Returns the paths of the parameters to which the options refer."
  @spec paths(t()) :: [BB.Parameter.path()]
  def paths(%__MODULE__{options: options, transmission: transmission}),
    do: Enum.uniq(Reference.paths(options) ++ Reference.paths(transmission))

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
      own = resolution.kind.component_options(resolution.joint_name, transmission)
      {:ok, [bb: bb] ++ own ++ options}
    end
  end

  defp validate(%{module: module, bb: bb}, given) do
    with {:error, %ValidationError{} = error} <- Options.validate(given, schema(module)),
         do: {:error, %{error | keys_path: bb.path ++ error.keys_path}}
  end

  defp schema(module) do
    if Code.ensure_loaded?(module) and function_exported?(module, :options_schema, 0),
      do: module.options_schema(),
      else: []
  end

  defp transmission(%{transmission: declared, bb: bb}, value) do
    with {:error, error} <- Transmission.resolve(declared, value),
         do: {:error, %{error | keys_path: bb.path ++ error.keys_path}}
  end

  defp put_place(resolution, nil), do: resolution

  defp put_place(resolution, component) do
    joint_name = with {:joint, name} <- component.attached_to, do: name, else: (_ -> nil)
    %{resolution | joint_name: joint_name, transmission: component.transmission}
  end

  defp fetch_declared(robot, name) do
    with true <- Code.ensure_loaded?(robot) and function_exported?(robot, :robot, 0),
         {:ok, component} <- Robot.fetch_component(robot.robot(), name) do
      component
    else
      _ -> nil
    end
  end
end

defmodule BB.Component.Resolution do
  @moduledoc """
  From a component's options as declared to those that its callbacks get: references are replaced by values, all is checked
  against the module's schema, and what its place means is added. Pure.
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

  @doc "What is to be resolved for a module at `bb.path` of the robot, which may have no declaration in a driver's test."
  @spec new(module(), module(), map(), keyword()) :: t()
  def new(kind, module, bb, options) do
    at(
      %__MODULE__{kind: kind, module: module, bb: bb, options: options},
      declared(bb.robot, List.last(bb.path))
    )
  end

  @doc "The same for a component of a robot's declaration."
  @spec of(module(), Component.t()) :: t()
  def of(robot, %Component{} = component) do
    bb = %{robot: robot, path: component.path}
    resolution = %__MODULE__{kind: component.kind, module: component.module, bb: bb, options: []}
    at(%{resolution | options: component.options}, component)
  end

  @doc "The parameters to which it refers."
  @spec paths(t()) :: [BB.Parameter.path()]
  def paths(%__MODULE__{options: options, transmission: transmission}),
    do: Enum.uniq(Reference.paths(options) ++ Reference.paths(transmission))

  @doc "The options for `init/1` and `handle_options/2`, with these values of parameters; or the error, whose `keys_path` begins with the path."
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

  defp at(resolution, nil), do: resolution

  defp at(resolution, component) do
    joint_name = with {:joint, name} <- component.attached_to, do: name, else: (_ -> nil)
    %{resolution | joint_name: joint_name, transmission: component.transmission}
  end

  defp declared(robot, name) do
    with true <- Code.ensure_loaded?(robot) and function_exported?(robot, :robot, 0),
         {:ok, component} <- Robot.fetch_component(robot.robot(), name) do
      component
    else
      _ -> nil
    end
  end
end

defmodule BB.Process do
  @moduledoc """
  Where a robot's components are: each is registered by its name, unique in its robot, while it runs.
  """

  @doc "The name of a robot's process registry."
  @spec registry_name(module()) :: module()
  def registry_name(robot), do: Module.concat(robot, Registry)

  @doc "A component's name as `GenServer` and others take it: `{:via, Registry, {R.Registry, name}}`."
  @spec via(module(), term()) :: {:via, module(), {module(), term()}}
  def via(robot, name), do: {:via, registry_module(robot), {registry_name(robot), name}}

  @doc "The component's process, `:undefined` while it is down. Raises `ArgumentError` when the robot is not started."
  @spec whereis(module(), term()) :: pid() | :undefined
  def whereis(robot, name),
    do: registry_module(robot).whereis_name({registry_name(robot), name})

  @doc "The module of the robot's registry, `Registry` unless the robot's `settings` say otherwise."
  @spec registry_module(module()) :: module()
  def registry_module(robot), do: setting(robot, :registry_module, Registry)

  @doc "The module of the robot's supervisors, `Supervisor` unless the robot's `settings` say otherwise."
  @spec supervisor_module(module()) :: module()
  def supervisor_module(robot), do: setting(robot, :supervisor_module, Supervisor)

  @doc "The registry's place under the robot's root."
  @spec registry_spec(module()) :: Supervisor.module_spec()
  def registry_spec(robot) do
    options = setting(robot, :registry_options, [])
    {registry_module(robot), [keys: :unique, name: registry_name(robot)] ++ options}
  end

  # A driver's test need not have a robot.
  defp setting(robot, key, default) do
    if Code.ensure_loaded?(robot) and function_exported?(robot, :robot, 0),
      do: Map.get(robot.robot().settings, key, default),
      else: default
  end
end

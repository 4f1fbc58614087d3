defmodule BB.Process do
  @moduledoc """
  The names of a robot's processes.

  Each component is registered under its name, unique in its robot, while it runs. Use these
  functions to find or call it:

      iex> BB.Process.via(MyRobot, :imu)
      {:via, Registry, {MyRobot.Registry, :imu}}

  With the name, `GenServer.call/3` and the like reach the component.
  """

  @doc "Returns the name of a robot's process registry."
  @spec registry_name(module()) :: module()
  def registry_name(robot), do: Module.concat(robot, Registry)

  @doc "Returns a component's name for `GenServer.call/3` and the like."
  @spec via(module(), term()) :: {:via, module(), {module(), term()}}
  def via(robot, name), do: {:via, registry_module(robot), {registry_name(robot), name}}

  @doc """
  Returns the process of a component, or `:undefined` while it is down.

  Raises `ArgumentError` when the robot is not started.
  """
  @spec whereis(module(), term()) :: pid() | :undefined
  def whereis(robot, name),
    do: registry_module(robot).whereis_name({registry_name(robot), name})

  @doc """
  Returns the module of the robot's registry, `Registry` unless its `settings` name another.
  """
  @spec registry_module(module()) :: module()
  def registry_module(robot), do: setting(robot, :registry_module, Registry)

  @doc """
  Returns the module of the robot's supervisors, `Supervisor` unless its `settings` name another.
  """
  @spec supervisor_module(module()) :: module()
  def supervisor_module(robot), do: setting(robot, :supervisor_module, Supervisor)

  @doc "Returns the child specification of the registry, for the robot's root supervisor."
  @spec registry_spec(module()) :: Supervisor.module_spec()
  def registry_spec(robot) do
    options = setting(robot, :registry_options, [])
    {registry_module(robot), [keys: :unique, name: registry_name(robot)] ++ options}
  end

  # The robot of a driver's test may have no settings.
  defp setting(robot, key, default) do
    if Code.ensure_loaded?(robot) and function_exported?(robot, :robot, 0),
      do: Map.get(robot.robot().settings, key, default),
      else: default
  end
end

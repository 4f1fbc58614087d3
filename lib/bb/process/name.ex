defmodule BB.Process.Name do
  @moduledoc """
  The names in a robot's process registry. `BB.Process` has the same functions; use this module
  where a module may not name those that start components.

      iex> BB.Process.Name.via(MyRobot, :imu)
      {:via, Registry, {MyRobot.Registry, :imu}}
  """

  @doc "Returns the name of a robot's process registry."
  @spec registry_name(module()) :: module()
  def registry_name(robot), do: Module.concat(robot, Registry)

  @doc "Returns the name of a process for `GenServer.call/3` and the like."
  @spec via(module(), term()) :: {:via, module(), {module(), term()}}
  def via(robot, name), do: {:via, registry_module(robot), {registry_name(robot), name}}

  @doc """
  Returns the module of the robot's registry, `Registry` unless its `settings` name another.
  """
  @spec registry_module(module()) :: module()
  def registry_module(robot), do: setting(robot, :registry_module, Registry)

  @doc "Returns one of the robot's settings, or the default."
  @spec setting(module(), atom(), term()) :: term()
  def setting(robot, key, default) do
    # The robot of a driver's test may have no settings.
    if Code.ensure_loaded?(robot) and function_exported?(robot, :robot, 0),
      do: Map.get(robot.robot().settings, key, default),
      else: default
  end
end

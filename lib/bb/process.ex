defmodule BB.Process do
  @moduledoc """
  Where a robot's components are: each is registered by its name, unique in its robot, while it runs.
  """

  @doc "The name of a robot's process registry."
  @spec registry_name(module()) :: module()
  def registry_name(robot), do: Module.concat(robot, Registry)

  @doc "A component's name as `GenServer` and others take it."
  @spec via(module(), term()) :: {:via, Registry, {module(), term()}}
  def via(robot, name), do: {:via, Registry, {registry_name(robot), name}}

  @doc "The component's process, `:undefined` while it is down. Raises `ArgumentError` when the robot is not started."
  @spec whereis(module(), term()) :: pid() | :undefined
  def whereis(robot, name), do: Registry.whereis_name({registry_name(robot), name})
end

defmodule BB.Supervisor.Name do
  @moduledoc """
  Registers a supervisor of a robot in the robot's registry, from the supervisor's `init/1`.
  `BB.Supervisor.Topology` uses it.

      BB.Process.whereis(MyRobot, BB.TopologySupervisor)
  """

  @doc """
  Registers the calling process under a name.

  It is not registered while the registry is being restarted, or while another process has the
  name. A supervisor must start then too.
  """
  @spec register(module(), module()) :: :ok
  def register(robot, name) do
    registry = BB.Process.registry_module(robot)
    _ = registry.register(BB.Process.registry_name(robot), name, nil)
    :ok
  rescue
    ArgumentError -> :ok
  end
end

defmodule BB.Robot.SimulationMode do
  @moduledoc """
  How a robot that runs is simulated, and which components it has then.

  `BB.Supervisor` sets it when a robot starts with `simulation:`. Any process may read it:

      iex> BB.Robot.SimulationMode.mode(NoRobot)
      nil
  """

  alias BB.Component

  @type mode :: :kinematic | :external

  @doc "Returns how the robot is simulated, `nil` for a robot with its own hardware."
  @spec mode(module()) :: mode() | nil
  def mode(robot) do
    case :persistent_term.get({__MODULE__, robot}, nil) do
      {mode, _components} -> mode
      nil -> nil
    end
  end

  @doc """
  Returns the components that the robot starts: the declared ones, unless the robot is simulated.
  """
  @spec components(module()) :: [Component.t()]
  def components(robot) do
    case :persistent_term.get({__MODULE__, robot}, nil) do
      {_mode, components} -> components
      nil -> robot.robot().components
    end
  end

  @doc "Sets the mode of a robot that is about to start, with its components."
  @spec put(module(), mode() | nil, [Component.t()]) :: :ok
  def put(robot, nil, _components) do
    _ = :persistent_term.erase({__MODULE__, robot})
    :ok
  end

  def put(robot, mode, components),
    do: :persistent_term.put({__MODULE__, robot}, {mode, components})
end

defmodule BB.Test.Robot do
  @moduledoc """
  Robots for tests.

  A robot is a module, so that each test makes its own at run time, with a unique name:

      robot = robot do
        topology do
          link :base_link do
            sensor :imu, BB.Test.Probe
          end
        end
      end

      start_supervised!(robot)

  The declaration is code of the robot's module. It sees variables of the test only by `unquote`,
  in a `quote` that is given to `create/1`.
  """

  @doc "Makes a robot module and returns it."
  defmacro robot(do: block) do
    quote do: BB.Test.Robot.create(unquote(Macro.escape(block)))
  end

  @doc "Makes a robot module of a quoted declaration and returns it."
  def create(block) do
    robot = Module.concat(BB.Test.Robot, "R#{System.unique_integer([:positive])}")
    code = quote(do: [use(BB), unquote(block)])
    {:module, ^robot, _, _} = Module.create(robot, code, Macro.Env.location(__ENV__))
    robot
  end

  @doc """
  Returns the pids of all supervisors and keepers of a robot, by their ids from the root on.
  """
  def supervisors(robot), do: supervisors(Process.whereis(robot), [robot])

  defp supervisors(pid, id) do
    pid
    |> Supervisor.which_children()
    |> Enum.flat_map(fn {child, pid, _type, _modules} ->
      if part?(child), do: supervisors(pid, [child | id]), else: []
    end)
    |> then(&[{Enum.reverse(id), pid} | &1])
  end

  defp part?(id) when id in [BB.TopologySupervisor, BB.SensorSupervisor, BB.ControllerSupervisor],
    do: true

  defp part?({kind, _name}), do: kind in [:link, :joint, :sensor, :actuator, :controller]
  defp part?(_id), do: false

  @doc "Returns the pid of a component's keeper."
  def keeper(robot, name) do
    {_id, pid} =
      robot |> supervisors() |> Enum.find(fn {id, _pid} -> List.last(id) == {:sensor, name} end)

    pid
  end

  @doc """
  Waits until every component of a robot is up in the current tree.

  A killed topology leaves components behind for a moment, which still have rows and handlers.
  """
  def await_all_up(robot) do
    BB.Test.Eventually.eventually(fn ->
      rows = rows(robot)
      rows != [] and Enum.all?(rows, &(&1.state == :up and in_topology?(robot, &1.pid)))
    end)
  end

  defp rows(robot) do
    BB.Sensor.health(robot) ++ BB.Actuator.health(robot) ++ BB.Controller.health(robot)
  rescue
    ArgumentError -> []
  end

  defp in_topology?(robot, pid) do
    root = Process.whereis(robot)
    {:dictionary, dictionary} = Process.info(pid, :dictionary)

    {_id, topology, _, _} =
      root |> Supervisor.which_children() |> List.keyfind(BB.TopologySupervisor, 0)

    topology in dictionary[:"$ancestors"]
  rescue
    # The process has just ended.
    _error -> false
  catch
    :exit, _reason -> false
  end

  @doc "Returns the health of the sensor with that name."
  def health(robot, name), do: robot |> BB.Sensor.health() |> Enum.find(&(&1.name == name))
end

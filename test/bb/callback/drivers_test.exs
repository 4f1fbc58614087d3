defmodule BB.Callback.DriversTest do
  @moduledoc "Each callback of a driver fails in every way, without an effect on other processes."
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Neighbourhood
  import BB.Test.Robot, only: [health: 2]

  alias BB.Test.Mischief

  @moduletag :tmp_dir

  # Calls the callbacks that the robot does not call by itself.

  defp provoke(:rate, robot), do: BB.Sensor.health(robot)
  defp provoke(:handle_info, robot), do: send(BB.Process.whereis(robot, :bad), :now)
  defp provoke(:handle_cast, robot), do: BB.cast(robot, :bad, :now)
  defp provoke(:handle_call, robot), do: spawn(fn -> BB.call(robot, :bad, :now) end)
  defp provoke(:handle_options, robot), do: :ok = BB.Parameter.set(robot, [:n], 2)
  defp provoke(_callback, _robot), do: :ok

  # The callbacks that run when the robot stops.
  @late [:terminate, :disarm]

  for callback <- Mischief.callbacks(), kind <- Mischief.kinds() do
    module = Mischief.driver(callback, kind)
    @tag callback: callback, kind: kind, culprit: module, robot: declared(child(callback, module))
    test "#{callback} does not hurt others: #{kind}", context do
      %{callback: callback, kind: kind, culprit: module, robot: robot} = context
      root = start(robot)
      neighbour = BB.Process.whereis(robot, :neighbour)

      if up?(callback), do: eventually(fn -> health(robot, :bad).state == :up end, long_ms())
      provoke(callback, robot)
      unless callback in @late, do: happens!(module)
      says!(callback, kind, robot)

      unnoticed!(robot, root, neighbour, context)
      happens!(module)
    end
  end

  defp up?(callback),
    do: callback in [:rate, :handle_info, :handle_cast, :handle_call, :handle_options | @late]

  # The health of the component itself.

  defp says!(:explain, kind, robot) when kind != :huge do
    assert eventually(fn -> health(robot, :bad).state == :backoff end, long_ms())
    assert %{reason: {:absent, 1}, error: "{:absent, 1}"} = health(robot, :bad)
    assert BB.Sensor.explain(health(robot, :bad).module, {:absent, 1}) == "{:absent, 1}"
  end

  defp says!(:explain, :huge, robot) do
    assert eventually(fn -> health(robot, :bad).state == :backoff end, long_ms())
    assert byte_size(health(robot, :bad).error) < 10_000
  end

  defp says!(:rate, _kind, robot),
    do: assert(%{state: :up, restarts: 0, declared_hz: nil} = health(robot, :bad))

  defp says!(callback, kind, robot)
       when callback in [:check, :options_schema] and kind not in [:wrong, :huge] do
    assert eventually(fn -> health(robot, :bad).error end, long_ms()) =~
             "options could not be checked: "
  end

  defp says!(:inhibition, kind, robot) when kind not in [:wrong] do
    assert [{[:base, :bad], {:inhibition_failed, words}}] = BB.Safety.inhibitions(robot)
    assert is_binary(words)
    assert {:error, {:inhibited, _}} = BB.Safety.arm(robot)
  end

  defp says!(_callback, _kind, _robot), do: :ok
end

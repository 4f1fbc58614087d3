defmodule BB.Test.Chaos.Core.Watchdog do
  @moduledoc "Who vouches for an armed robot: a sensor in its tree, and, started by `start_link/1`, a process outside of it."

  use BB.Sensor

  @again_ms 10

  @impl BB.Sensor
  def init(opts) do
    :ok = BB.Safety.vouch(opts[:bb].robot, opts[:bb].path)
    {:ok, opts[:bb]}
  end

  @doc "A child outside of the robot's tree, which vouches as soon as that is possible."
  def child_spec(robot),
    do: %{id: {:voucher, robot}, start: {__MODULE__, :start_link, [robot]}}

  @doc "Starts it."
  def start_link(robot), do: {:ok, spawn_link(fn -> vouch(robot) end)}

  defp vouch(robot) do
    :ok = BB.Safety.vouch(robot, [:outside])
    Process.sleep(:infinity)
  rescue
    _not_running -> again(robot)
  catch
    :exit, _not_running -> again(robot)
  end

  defp again(robot) do
    Process.sleep(@again_ms)
    vouch(robot)
  end
end

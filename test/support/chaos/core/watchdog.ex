defmodule BB.Test.Chaos.Core.Watchdog do
  @moduledoc """
  Vouches for an armed robot: as a sensor in its tree, or as a process outside of it
  (`start_link/1`).
  """

  use BB.Sensor

  @again_ms 10

  @impl BB.Sensor
  def init(opts) do
    :ok = BB.Safety.vouch(opts[:bb].robot, opts[:bb].path)
    {:ok, opts[:bb]}
  end

  @doc "A child outside of the robot's tree, which vouches as soon as possible."
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

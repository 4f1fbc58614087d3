defmodule BB.Component.ShutdownLimit do
  @moduledoc """
  The time that a component may take to stop before its keeper kills it.

  `BB.Component.Keeper` asks for the limit when it stops a component, and records a component that
  exceeded it.

  A robot's components stop one after the other, so that each can rely on those declared before
  it. When their shared bus hangs, many of them hang. The robot's end, and its disarming, must not
  wait the full time for each: after the first component has exceeded its limit, each of the
  others has a second.
  """
  @moduledoc no_example: "internal: BB.Sensor.shut_down_within/1 sets the limit of a component"

  alias BB.Component.Heartbeat

  @reduced_ms 1_000
  @remembered_ms 60_000

  @doc """
  Returns the limit of a component of the robot.

  `own_ms` is the component's own limit. A component that has set its limit itself
  (`BB.Sensor.shut_down_within/1`) keeps it even when another one was late.
  """
  @spec limit_ms(module(), non_neg_integer()) :: non_neg_integer()
  def limit_ms(robot, own_ms) do
    set? = own_ms != Heartbeat.default_shutdown_ms()
    if not set? and exceeded?(robot), do: @reduced_ms, else: own_ms
  end

  @doc "Records why a component could not be stopped, if it exceeded its limit."
  @spec record(module(), reason :: term()) :: :ok
  def record(robot, {:timeout, _call}), do: record(robot, :timeout)

  def record(robot, :timeout) do
    {module, registry} = registry(robot)
    module.put_meta(registry, __MODULE__, now_ms())
  rescue
    # The registry has stopped before the components.
    ArgumentError -> :ok
  end

  def record(_robot, _reason), do: :ok

  defp exceeded?(robot) do
    {module, registry} = registry(robot)

    case module.meta(registry, __MODULE__) do
      {:ok, at_ms} -> now_ms() - at_ms < @remembered_ms
      :error -> false
    end
  rescue
    ArgumentError -> false
  end

  defp registry(robot), do: {BB.Process.registry_module(robot), BB.Process.registry_name(robot)}
  defp now_ms, do: System.monotonic_time(:millisecond)
end

defmodule BB.Component.ShutdownLimit do
  @moduledoc """
  How long a component that is stopped may take before it is killed.

  A robot's components end one after the other, so that one can rely on those declared before it.
  Many that hang, as they do when the bus that they share hangs, must not hold up the robot's end,
  and its disarming, by that time each: the first that was not done in time had it for all of
  them, and each of the others has a second.
  """

  alias BB.Component.Heartbeat

  @second_ms 1_000
  @together_ms 60_000

  @doc """
  The limit for a component of a robot that has `own_ms` when no other was late. One that has said
  itself how long its end takes (`BB.Sensor.shut_down_within/1`) keeps that.
  """
  @spec limit_ms(module(), non_neg_integer()) :: non_neg_integer()
  def limit_ms(robot, own_ms) do
    said? = own_ms != Heartbeat.default_shutdown_ms()
    if not said? and late?(robot), do: @second_ms, else: own_ms
  end

  @doc "A component was not stopped: remembers it when that is because it was late."
  @spec ended(module(), reason :: term()) :: :ok
  def ended(robot, {:timeout, _call}), do: ended(robot, :timeout)

  def ended(robot, :timeout) do
    {module, registry} = registry(robot)
    module.put_meta(registry, __MODULE__, now_ms())
  rescue
    # The registry ended before the components.
    ArgumentError -> :ok
  end

  def ended(_robot, _reason), do: :ok

  defp late?(robot) do
    {module, registry} = registry(robot)

    case module.meta(registry, __MODULE__) do
      {:ok, at_ms} -> now_ms() - at_ms < @together_ms
      :error -> false
    end
  rescue
    ArgumentError -> false
  end

  defp registry(robot), do: {BB.Process.registry_module(robot), BB.Process.registry_name(robot)}
  defp now_ms, do: System.monotonic_time(:millisecond)
end

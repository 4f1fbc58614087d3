defmodule BB.Component.StatusEvents do
  @moduledoc """
  The events of a change in a component's status: an alarm, a telemetry event, a line in the log
  and a message on the bus.

  `BB.Component.Keeper` calls these functions in its own process.
  """
  @moduledoc no_example: "internal: BB.Component.Keeper calls it on each change of status"

  require Logger

  alias BB.{Component, Message, PubSub}
  alias BB.Component.Status

  @doc "Emits the events of a change from one status to another."
  @spec emit(module(), Component.t(), Status.t(), Status.t()) :: :ok
  def emit(robot, component, old, new) do
    update_alarm(robot, component, old, new)
    emit_telemetry(robot, component, new)
    log(robot, component, old, new)
    publish(robot, component, new)
  end

  @doc "Clears the component's alarm."
  @spec clear_alarm(module(), Component.t()) :: :ok
  def clear_alarm(robot, component),
    do: with_alarm_handler(fn -> :alarm_handler.clear_alarm(alarm_id(robot, component)) end)

  # An alarm handler may print each event, so it receives changes only.
  defp update_alarm(robot, component, old, new) do
    case {Status.alarm?(old), Status.alarm?(new)} do
      {false, true} -> set_alarm(robot, component, new)
      {true, false} -> clear_alarm(robot, component)
      _ -> :ok
    end
  end

  defp set_alarm(robot, component, status) do
    alarm = {alarm_id(robot, component), %{state: status.state, reason: status.reason}}
    with_alarm_handler(fn -> :alarm_handler.set_alarm(alarm) end)
  end

  defp alarm_id(robot, component), do: {component.kind, robot, component.path}

  # A release may have been built without SASL, which starts the alarm handler.
  defp with_alarm_handler(fun) do
    if Process.whereis(:alarm_handler), do: fun.()
    :ok
  end

  defp emit_telemetry(robot, component, status) do
    metadata = %{
      robot: robot,
      path: component.path,
      state: status.state,
      reason: status.reason
    }

    BB.Telemetry.emit(
      [:bb, component.kind.component_kind(), :status],
      %{restarts: status.restarts},
      metadata,
      apart: true
    )
  end

  defp log(robot, component, old, %{state: :up}) do
    if Status.alarm?(old), do: Logger.info("#{title(robot, component)} is up again")
  end

  defp log(robot, component, _old, %{state: :backoff, error: error}),
    do: Logger.warning("#{title(robot, component)} is down, restarting until it is up: #{error}")

  defp log(robot, component, _old, %{state: :stale, error: error}),
    do: Logger.warning("#{title(robot, component)} is silent: #{error}")

  defp log(robot, component, _old, %{state: :ignored}),
    do: Logger.info("#{title(robot, component)} is off: its init/1 returned :ignore")

  defp title(robot, component) do
    "#{inspect(robot)}: #{component.kind.component_kind()} #{inspect(component.name)}"
  end

  defp publish(robot, component, status) do
    {:ok, message} =
      Message.new(Message.Sensor.Status, component.name,
        state: status.state,
        reason: status.reason,
        restarts: status.restarts,
        retry_in_ms: status.retry_in_ms
      )

    PubSub.publish(robot, Component.status_path(component), message)
  rescue
    # The pubsub is being restarted, and has no subscribers.
    ArgumentError -> :ok
  end
end

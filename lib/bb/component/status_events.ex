defmodule BB.Component.StatusEvents do
  @moduledoc """
  Tells the world of a change in how a component fares: alarm, telemetry, log, message. Runs in the component's keeper.
  """

  require Logger

  alias BB.{Component, Message, PubSub}
  alias BB.Component.Status

  @doc "Tells that a component went from one status to another."
  @spec emit(module(), Component.t(), Status.t(), Status.t()) :: :ok
  def emit(robot, component, old, new) do
    alarm(robot, component, old, new)
    telemetry(robot, component, new)
    log(robot, component, old, new)
    publish(robot, component, new)
  end

  @doc "Clears the component's alarm."
  @spec clear_alarm(module(), Component.t()) :: :ok
  def clear_alarm(robot, component),
    do: with_alarms(fn -> :alarm_handler.clear_alarm(alarm_id(robot, component)) end)

  # A handler may show each event that it gets, so it gets only changes.
  defp alarm(robot, component, old, new) do
    case {Status.alarming?(old), Status.alarming?(new)} do
      {false, true} -> set_alarm(robot, component, new)
      {true, false} -> clear_alarm(robot, component)
      _ -> :ok
    end
  end

  defp set_alarm(robot, component, status) do
    description = %{state: status.state, reason: status.reason}
    with_alarms(fn -> :alarm_handler.set_alarm({alarm_id(robot, component), description}) end)
  end

  defp alarm_id(robot, component), do: {component.kind, robot, component.path}

  # SASL, which has the alarm handler, may have been left out of a release.
  defp with_alarms(change) do
    if Process.whereis(:alarm_handler), do: change.()
    :ok
  end

  defp telemetry(robot, component, status) do
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
    if Status.alarming?(old), do: Logger.info("#{title(robot, component)} is up again")
  end

  defp log(robot, component, _old, %{state: :backoff} = status) do
    Logger.warning([
      title(robot, component),
      " is down and will be started again until it is up: ",
      status.error
    ])
  end

  defp log(robot, component, _old, %{state: :stale} = status),
    do: Logger.warning("#{title(robot, component)} is silent: #{status.error}")

  defp log(robot, component, _old, %{state: :ignored}),
    do: Logger.info("#{title(robot, component)} is off: its init returned :ignore")

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
    # The bus is being restarted, and nobody is subscribed to it.
    ArgumentError -> :ok
  end
end

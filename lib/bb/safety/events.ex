defmodule BB.Safety.Events do
  @moduledoc """
  Emits the events of a robot's safety: messages on the pubsub, telemetry events and log lines.
  `BB.Safety.Warden` calls it in its own process.

      iex> BB.Safety.Events.format_failure({[:base, :servo], {:returned_error, :enodev}})
      "[:base, :servo] returned {:error, :enodev}"
  """

  require Logger

  alias BB.{Message, PubSub, Telemetry}
  alias BB.Safety.{Record, Round}
  alias BB.StateMachine.Transition

  @doc "Emits a transition between two states."
  @spec transition(Record.t(), Record.t()) :: :ok
  def transition(%{robot: robot, state: from}, %{state: to, epoch: epoch}) do
    publish(robot, from, to)
    metadata = %{robot: robot, from: from, to: to, epoch: epoch}
    measurements = %{system_time: System.system_time()}
    emit([:bb, :safety, :transition], measurements, metadata)
  end

  @doc "Emits the begin of a disarming."
  @spec disarm_started(module(), Round.t()) :: :ok
  def disarm_started(robot, round) do
    log_cause(robot, round.cause)

    emit(
      [:bb, :safety, :disarm, :start],
      %{monotonic_time: round.started, system_time: System.system_time()},
      metadata(robot, round)
    )
  end

  @doc "Emits the end of a disarming, with its failures."
  @spec disarm_stopped(module(), Round.t(), [Round.failure()]) :: :ok
  def disarm_stopped(robot, round, failures) do
    for failure <- failures,
        do: Logger.error("#{inspect(robot)}: not disarmed: #{format_failure(failure)}")

    now = System.monotonic_time()
    metadata = robot |> metadata(round) |> Map.put(:failures, failures)

    emit(
      [:bb, :safety, :disarm, :stop],
      %{duration: now - round.started, monotonic_time: now},
      metadata
    )
  end

  @doc """
  Formats a failure of a handler.

      iex> BB.Safety.Events.format_failure({[:base, :servo], {:timeout, 5_000}})
      "[:base, :servo] did not return within 5000 ms"
  """
  @spec format_failure(Round.failure()) :: String.t()
  def format_failure({path, error}), do: "#{inspect(path)} #{format_error(error)}"

  defp format_error({:timeout, timeout_ms}), do: "did not return within #{timeout_ms} ms"
  defp format_error({:exception, message}), do: "raised: #{message}"

  defp format_error({:returned_error, {:bad_return_value, other}}),
    do: "returned #{inspect(other)}, which is neither :ok nor {:error, reason}"

  defp format_error({:returned_error, reason}), do: "returned {:error, #{inspect(reason)}}"
  defp format_error({:throw, value}), do: "threw #{inspect(value)}"
  defp format_error({:exit, reason}), do: "exited: #{Exception.format_exit(reason)}"

  # A telemetry handler may hang, and the warden must not wait for it. A process of its own emits
  # each event, after the event before.
  defp emit(event, measurements, metadata) do
    before = Process.get(__MODULE__)

    emitter =
      spawn(fn ->
        await_end(before)
        Telemetry.emit(event, measurements, metadata, apart: true)
      end)

    Process.put(__MODULE__, emitter)
    :ok
  end

  defp await_end(nil), do: :ok

  defp await_end(pid) do
    ref = Process.monitor(pid)
    receive do: ({:DOWN, ^ref, :process, ^pid, _reason} -> :ok)
  end

  defp metadata(robot, round),
    do: %{robot: robot, cause: round.cause, telemetry_span_context: {robot, round.id}}

  defp log_cause(robot, {role, :ended}),
    do:
      Logger.warning(
        "#{inspect(robot)} runs its disarm handlers: its #{describe(role)} ended while " <>
          "it was armed"
      )

  defp log_cause(_robot, _cause), do: :ok

  defp describe(:root), do: "root supervisor"
  defp describe(:topology), do: "topology supervisor"
  defp describe({:voucher, path}), do: "voucher #{inspect(path)}"

  defp publish(robot, from, to) do
    PubSub.publish(
      robot,
      [:state_machine],
      Message.new!(Transition, :state_machine, from: from, to: to)
    )
  rescue
    # The robot has ended, or its pubsub is being restarted: it has no subscriber.
    ArgumentError -> :ok
  end
end

defmodule BB.Safety.Events do
  @moduledoc "Tells the world how a robot's safety changes: message, telemetry, log. Runs in the robot's warden."

  require Logger

  alias BB.{Message, PubSub, Telemetry}
  alias BB.Safety.{Record, Round}
  alias BB.StateMachine.Transition

  @doc "Tells of a transition."
  @spec transition(Record.t(), Record.t()) :: :ok
  def transition(%{robot: robot, state: from}, %{state: to, epoch: epoch}) do
    publish(robot, from, to)
    metadata = %{robot: robot, from: from, to: to, epoch: epoch}
    measurements = %{system_time: System.system_time()}
    emit([:bb, :safety, :transition], measurements, metadata)
  end

  @doc "Tells that a disarming began."
  @spec began(module(), Round.t()) :: :ok
  def began(robot, round) do
    log_cause(robot, round.cause)

    emit(
      [:bb, :safety, :disarm, :start],
      %{monotonic_time: round.started, system_time: System.system_time()},
      metadata(robot, round)
    )
  end

  @doc "Tells how a disarming ended."
  @spec ended(module(), Round.t(), [Round.failure()]) :: :ok
  def ended(robot, round, failures) do
    for failure <- failures,
        do: Logger.error("#{inspect(robot)}: not disarmed: #{words(failure)}")

    now = System.monotonic_time()
    metadata = robot |> metadata(round) |> Map.put(:failures, failures)

    emit(
      [:bb, :safety, :disarm, :stop],
      %{duration: now - round.started, monotonic_time: now},
      metadata
    )
  end

  @doc """
  A failure in words.

      iex> BB.Safety.Events.words({[:base, :servo], {:timeout, 5_000}})
      "[:base, :servo] did not return within 5000 ms"
      iex> BB.Safety.Events.words({[:base, :servo], {:returned_error, :enodev}})
      "[:base, :servo] returned {:error, :enodev}"
  """
  @spec words(Round.failure()) :: String.t()
  def words({path, error}), do: "#{inspect(path)} #{how(error)}"

  defp how({:timeout, timeout_ms}), do: "did not return within #{timeout_ms} ms"
  defp how({:exception, message}), do: "raised: #{message}"

  defp how({:returned_error, {:bad_return_value, other}}),
    do: "returned #{inspect(other)}, which is neither :ok nor {:error, reason}"

  defp how({:returned_error, reason}), do: "returned {:error, #{inspect(reason)}}"
  defp how({:throw, value}), do: "threw #{inspect(value)}"
  defp how({:exit, reason}), do: "exited: #{Exception.format_exit(reason)}"

  # Handlers of telemetry may hang, and the warden waits for none of them: whom it watches may die
  # at any moment. Each event is told by a process of its own, after the one before it.
  defp emit(event, measurements, metadata) do
    before = Process.get(__MODULE__)

    teller =
      spawn(fn ->
        await_end(before)
        Telemetry.emit(event, measurements, metadata, apart: true)
      end)

    Process.put(__MODULE__, teller)
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
      Logger.warning("#{inspect(robot)} is disarmed: its #{part(role)} ended while it was armed")

  defp log_cause(_robot, _cause), do: :ok

  defp part(:root), do: "root supervisor"
  defp part(:topology), do: "topology supervisor"
  defp part({:voucher, path}), do: "#{inspect(path)}, which watches over it,"

  defp publish(robot, from, to) do
    PubSub.publish(
      robot,
      [:state_machine],
      Message.new!(Transition, :state_machine, from: from, to: to)
    )
  rescue
    # The robot has ended, or its bus is being restarted: nobody is subscribed to it.
    ArgumentError -> :ok
  end
end

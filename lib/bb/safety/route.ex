defmodule BB.Safety.Route do
  @moduledoc """
  Arms and disarms a robot by the commands that the robot declares for it, `arm true` and
  `disarm true`. `BB.Safety` calls it.

  The commands run in the robot's own processes, which this module reaches by a name and by
  messages alone. Whatever they do, an armed robot is not armed any more when `disarm/2` returns:
  without a command's success the handlers run, and the robot is in the state `:error`.
  """
  @moduledoc no_example: "internal: BB.Safety is its interface"

  alias BB.Safety.{Records, Wardens}

  @doc """
  Returns the name of the process that executes a robot's commands. It answers the calls
  `{BB.Safety.Route, :arm}` and `{BB.Safety.Route, :disarm}` with `{:done, result}`, or with
  `:direct` to the execution of that very command.
  """
  @spec name(module()) :: module()
  def name(robot), do: Module.concat(robot, Commands)

  @doc "Arms a robot, by its command if it has one."
  @spec arm(module()) :: :ok | {:error, term()}
  def arm(robot) do
    if Records.state(robot) == :disarmed and command?(robot, :arm),
      do: robot |> execute(:arm) |> finish_arming(robot),
      else: Wardens.arm(robot)
  end

  defp finish_arming(:direct, robot), do: Wardens.arm(robot)
  defp finish_arming({:done, {:error, reason}}, _robot), do: {:error, reason}

  defp finish_arming({:done, _result}, robot) do
    if Records.state(robot) == :armed,
      do: :ok,
      else: {:error, {:arm_command_failed, :not_armed}}
  end

  @doc "Disarms a robot, by its command if it has one."
  @spec disarm(module(), pos_integer()) :: :ok | {:error, term()}
  def disarm(robot, timeout_ms) do
    if Records.state(robot) == :armed and command?(robot, :disarm),
      do: robot |> execute(:disarm) |> finish_disarming(robot, timeout_ms),
      else: Wardens.disarm(robot, timeout_ms)
  end

  defp finish_disarming(:direct, robot, timeout_ms), do: Wardens.disarm(robot, timeout_ms)

  defp finish_disarming({:done, {:error, reason}}, robot, _timeout_ms) do
    if Records.state(robot) == :disarmed do
      :ok
    else
      _ = Wardens.fail(robot)
      {:error, {:disarm_command_failed, reason}}
    end
  end

  # The command may have left the rest to the handlers.
  defp finish_disarming({:done, _result}, robot, timeout_ms) do
    case Records.state(robot) do
      :disarmed -> :ok
      :error -> {:error, {:disarm_command_failed, :in_error}}
      _armed -> Wardens.disarm(robot, timeout_ms)
    end
  end

  # A robot that a driver's test starts in part executes no commands.
  defp command?(robot, flag) do
    Process.whereis(robot) != nil and Code.ensure_loaded?(robot) and
      function_exported?(robot, :"__bb_#{flag}_command__", 0) and command(robot, flag) != nil
  end

  defp command(robot, :arm), do: robot.__bb_arm_command__()
  defp command(robot, :disarm), do: robot.__bb_disarm_command__()

  defp execute(robot, flag) do
    GenServer.call(name(robot), {__MODULE__, flag}, :infinity)
  catch
    :exit, {reason, {GenServer, :call, _arguments}} -> {:done, {:error, reason}}
  end
end

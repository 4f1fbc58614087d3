defmodule BB.Parameter.Alarm do
  @moduledoc """
  Sets and clears the OTP alarms about a robot's parameters, `{BB.Parameter, robot, kind}`.
  `BB.Parameter.Persistence` uses it. The kinds:

    * `:not_kept` - values are set that the store has not saved
    * `:damaged` - the store has lost values, or may have lost some

  An alarm handler may show each event that it receives, so it receives changes only. The table of
  the robot's parameters remembers which alarms are set, for the successor of a killed process.
  """
  @moduledoc no_example: "internal: users read the alarms from :alarm_handler"

  alias BB.Parameter.Values

  @type kind :: :not_kept | :damaged
  @type id :: {BB.Parameter, robot :: module(), kind()}

  @doc "Sets an alarm, unless it is set already."
  @spec set(id(), description :: map()) :: :ok
  def set({_parameter, robot, kind} = id, description) do
    if Values.put_alarm(robot, kind),
      do: with_handler(fn -> :alarm_handler.set_alarm({id, description}) end),
      else: :ok
  end

  @doc "Clears an alarm, if it is set."
  @spec clear(id()) :: :ok
  def clear({_parameter, robot, kind} = id) do
    if Values.delete_alarm(robot, kind),
      do: with_handler(fn -> :alarm_handler.clear_alarm(id) end),
      else: :ok
  end

  # A release may leave out SASL, which has the alarm handler.
  defp with_handler(change) do
    _ = if Process.whereis(:alarm_handler), do: change.()
    :ok
  end
end

defmodule BB.Parameter.Alarm do
  @moduledoc """
  OTP's alarms about a robot's parameters, `{BB.Parameter, robot, which}`:

    * `:not_kept` - values are set that the store has not taken
    * `:damaged` - the store has lost values, or may have

  A handler may show each event that it gets, so it gets only changes. What is set stands in the
  robot's table, for the process after one that was killed.
  """

  alias BB.Parameter.Values

  @type which :: :not_kept | :damaged

  @doc "Sets an alarm, unless it is set already."
  @spec set(module(), which(), description :: map()) :: :ok
  def set(robot, which, description) do
    if Values.put_alarm(robot, which),
      do: with_alarms(fn -> :alarm_handler.set_alarm({id(robot, which), description}) end),
      else: :ok
  end

  @doc "Clears an alarm that is set."
  @spec clear(module(), which()) :: :ok
  def clear(robot, which) do
    if Values.delete_alarm(robot, which),
      do: with_alarms(fn -> :alarm_handler.clear_alarm(id(robot, which)) end),
      else: :ok
  end

  @doc "Clears what a process that was killed had set."
  @spec clear_left(module()) :: :ok
  def clear_left(robot), do: Enum.each([:not_kept, :damaged], &clear(robot, &1))

  defp id(robot, which), do: {BB.Parameter, robot, which}

  # SASL, which has the alarm handler, may have been left out of a release.
  defp with_alarms(change) do
    _ = if Process.whereis(:alarm_handler), do: change.()
    :ok
  end
end

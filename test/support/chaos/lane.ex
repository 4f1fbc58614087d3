defmodule BB.Test.Chaos.Lane do
  @moduledoc """
  Carries out the strikes of one lane.

  It begins a fault, waits until health shows it, ends it, and waits until all affected sensors
  are up and publish.
  """

  alias BB.Test.Chaos.Wires

  @look_ms 5
  @patience_ns 5_000_000_000

  @typedoc """
  The result of a strike. Times are nanoseconds; `shown_ns` and `up_ns` are `nil` if that never
  happened.
  """
  @type outcome :: %{
          strike: map(),
          began_ns: integer(),
          shown_ns: integer() | nil,
          ended_ns: integer(),
          up_ns: integer() | nil,
          heard_ns: integer()
        }

  @doc "Returns the records of the strikes, in their order."
  @spec run(module(), [map()], (outcome() -> term())) :: [outcome()]
  def run(robot, strikes, tell) do
    for strike <- strikes do
      record = strike(robot, strike)
      tell.(record)
      Process.sleep(strike.rest_ms)
      record
    end
  end

  defp strike(robot, strike) do
    began_ns = now_ns()
    :ok = Wires.break(strike.place, strike.fault)

    shown_ns =
      await(fn -> Enum.all?(rows(robot, strike), &(&1.state not in [:up, :starting])) end)

    Process.sleep(strike.hold_ms)
    ended_ns = now_ns()
    :ok = Wires.mend(strike.place, strike.fault)
    up_ns = await(fn -> Enum.all?(rows(robot, strike), &(&1.state == :up)) end)
    _ = await(fn -> Enum.all?(rows(robot, strike), &heard_since?(&1, ended_ns)) end)

    %{
      strike: strike,
      began_ns: began_ns,
      shown_ns: shown_ns,
      ended_ns: ended_ns,
      up_ns: up_ns,
      heard_ns: now_ns()
    }
  end

  defp rows(robot, strike),
    do: for(row <- BB.Sensor.health(robot), row.name in strike.sensors, do: row)

  # The sensor is up and has published since.
  defp heard_since?(row, ns),
    do: row.state == :up and row.age_ns != nil and now_ns() - row.age_ns > max(row.since, ns)

  defp await(fun), do: await(fun, now_ns() + @patience_ns)

  defp await(fun, until_ns) do
    cond do
      fun.() ->
        now_ns()

      now_ns() > until_ns ->
        nil

      true ->
        Process.sleep(@look_ms)
        await(fun, until_ns)
    end
  end

  defp now_ns, do: System.monotonic_time(:nanosecond)
end

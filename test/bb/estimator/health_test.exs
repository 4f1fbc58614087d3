defmodule BB.Estimator.HealthTest do
  use ExUnit.Case, async: true

  alias BB.Estimator.Health

  doctest Health

  defp after_events(events, recover_after \\ 1) do
    Enum.map_reduce(events, Health.new(recover_after), fn event, health ->
      case handle(event, health) do
        {:same, health} -> {:same, health}
        {:changed, health, reason} -> {{health.state, reason}, health}
      end
    end)
    |> elem(0)
  end

  defp handle(:good, health), do: Health.good(health)
  defp handle(:silent, health), do: Health.silent(health)
  defp handle(reason, health), do: Health.bad(health, reason)

  test "good inputs keep an estimator healthy" do
    assert after_events([:good, :good]) == [:same, :same]
  end

  test "a bad input degrades it, once" do
    assert after_events([:latency_overrun, :sync_miss]) == [{:degraded, :latency_overrun}, :same]
  end

  test "it recovers after good inputs in a row" do
    assert after_events([:sync_miss, :good]) == [{:degraded, :sync_miss}, {:healthy, :recovered}]

    assert after_events([:sync_miss, :good, :sync_miss, :good, :good], 2) ==
             [{:degraded, :sync_miss}, :same, :same, :same, {:healthy, :recovered}]
  end

  test "silence loses it, and the next good input degrades it" do
    assert after_events([:silent, :silent, :good, :good]) ==
             [{:lost, :lost}, :same, {:degraded, :input_resumed}, {:healthy, :recovered}]

    assert after_events([:silent, :sync_miss]) == [{:lost, :lost}, {:degraded, :sync_miss}]
    assert after_events([:sync_miss, :silent]) == [{:degraded, :sync_miss}, {:lost, :lost}]
  end
end

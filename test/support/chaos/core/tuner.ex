defmodule BB.Test.Chaos.Core.Tuner do
  @moduledoc """
  Sets parameters continuously, with one process for each, and checks each value before the next
  request.

  The possible values of each parameter, and the lost ones, are in a table of its own.
  """

  alias BB.Test.Chaos.Core.Verdict

  @longest_pause_ms 10

  @doc """
  Starts to set these parameters of these robots. The calling process owns the table, which is
  returned with the processes.
  """
  @spec start([module()], [[atom()]]) :: {:ets.tid(), [pid()]}
  def start(robots, paths) do
    table = :ets.new(__MODULE__, [:public])
    {table, for(robot <- robots, path <- paths, do: start_one(table, {robot, path}))}
  end

  defp start_one(table, key) do
    :ets.insert(table, {key, [0], 0})
    spawn_link(fn -> tune(table, key, 1) end)
  end

  @doc "Stops the processes, each after its current request."
  @spec stop([pid()]) :: :ok
  def stop(tuners) do
    for tuner <- tuners do
      ref = Process.monitor(tuner)
      send(tuner, :stop)
      receive do: ({:DOWN, ^ref, :process, ^tuner, _reason} -> :ok)
    end

    :ok
  end

  @doc """
  Checks all parameters once more and returns the lost values: `[{{robot, path}, value,
  possible}]`.
  """
  @spec lost(:ets.tid()) :: [{{module(), [atom()]}, term(), [term()]}]
  def lost(table) do
    for {key, possible, _acknowledged} <- :ets.tab2list(table) do
      check(table, key)
      if value(key) == :unknown, do: lose(table, key, :none, possible)
    end

    for {{:lost, _n}, key, value, possible} <- :ets.tab2list(table), do: {key, value, possible}
  end

  @doc "Returns the number of acknowledged requests."
  @spec acknowledged(:ets.tid()) :: non_neg_integer()
  def acknowledged(table),
    do: Enum.sum(for {_key, _possible, count} <- :ets.tab2list(table), do: count)

  defp tune(table, key, value) do
    receive do
      :stop -> :ok
    after
      :rand.uniform(@longest_pause_ms) ->
        check(table, key)
        set(table, key, value)
        tune(table, key, value + 1)
    end
  end

  # Recorded before the request, which may succeed although its answer is lost.
  defp set(table, {robot, path} = key, value) do
    [{_key, before, count}] = :ets.lookup(table, key)
    :ets.insert(table, {key, Verdict.possible(before, value, :unknown), count})

    if request(robot, path, value) == :ok,
      do: :ets.insert(table, {key, Verdict.possible(before, value, :ok), count + 1})
  end

  defp request(robot, path, value) do
    BB.Parameter.set(robot, path, value)
  rescue
    ArgumentError -> :not_started
  catch
    :exit, _gone -> :gone
  end

  defp check(table, key) do
    [{_key, possible, count}] = :ets.lookup(table, key)
    value = value(key)

    if Verdict.lost?(value, possible) do
      {:ok, value} = value
      lose(table, key, value, possible)
      :ets.insert(table, {key, [value], count})
    end
  end

  defp lose(table, key, value, possible),
    do: :ets.insert(table, {{:lost, System.unique_integer()}, key, value, possible})

  defp value({robot, path}) do
    with {:error, :not_found} <- BB.Parameter.get(robot, path), do: :unknown
  rescue
    ArgumentError -> :unknown
  end
end

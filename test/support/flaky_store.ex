defmodule BB.Test.FlakyStore do
  @moduledoc """
  A parameter store in memory that outlives its robot, and fails as scripted.

      FlakyStore.script(robot, load: fn -> raise "broken" end)

  Callbacks without a script work as in any store.
  """

  @behaviour BB.Parameter.Store

  @table __MODULE__

  @doc "Makes the table, once, in a process that outlives all tests."
  def setup, do: :ets.new(@table, [:named_table, :public])

  @doc "Scripts callbacks of a robot's store."
  def script(robot, callbacks) do
    for {callback, fun} <- callbacks, do: :ets.insert(@table, {{robot, callback}, fun})
    :ok
  end

  @doc "Removes the script of a callback."
  def reset(robot, callback), do: :ets.delete(@table, {robot, callback})

  @doc "Puts a value into a robot's store."
  def put(robot, path, value), do: :ets.insert(@table, {{robot, :value, path}, value})

  @doc "Returns the values in a robot's store."
  def all(robot) do
    rows = :ets.match(@table, {{robot, :value, :"$1"}, :"$2"})
    Map.new(rows, &List.to_tuple/1)
  end

  @impl BB.Parameter.Store
  def init(robot, _opts), do: run(robot, :init, fn -> {:ok, robot} end)

  @impl BB.Parameter.Store
  def load(robot), do: run(robot, :load, fn -> {:ok, Map.to_list(all(robot))} end)

  @impl BB.Parameter.Store
  def save(robot, path, value) do
    run(robot, :save, fn ->
      put(robot, path, value)
      :ok
    end)
  end

  @impl BB.Parameter.Store
  def close(robot), do: run(robot, :close, fn -> :ok end)

  @doc "Runs a callback's script, or else its default."
  def run(robot, callback, default), do: script_of(robot, callback, default).()

  @doc "Returns the script of a callback."
  def script_of(robot, callback, default) do
    case :ets.lookup(@table, {robot, callback}) do
      [{_, fun}] -> fun
      [] -> default
    end
  end
end

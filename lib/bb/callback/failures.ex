defmodule BB.Callback.Failures do
  @moduledoc """
  The failures that `BB.Callback` remembers: the functions that exceeded their time limit, and
  those whose failure was logged.

  `BB.Callback` reads and writes it before it calls a function, and before it logs a failure:

      Failures.hung?({MyRobot.Driver, :explain, 1})

  The table belongs to the process that calls `create/0`, that of the application. Without the
  table, no failure is remembered.
  """

  @table __MODULE__
  @hung_ms 60_000
  @log_interval_ms 600_000

  @doc "Creates the table if it does not exist."
  @spec create() :: :ok
  def create do
    if :ets.whereis(@table) == :undefined,
      do: @table = :ets.new(@table, [:named_table, :public, read_concurrency: true])

    :ok
  end

  @doc "Returns whether a function exceeded its time limit within the last minute."
  @spec hung?(BB.Callback.name()) :: boolean()
  def hung?(name) do
    :ets.lookup_element(@table, {:hung, name}, 2) > now_ms()
  rescue
    # The function or the table does not exist.
    ArgumentError -> false
  end

  @doc "Remembers that a function exceeded its time limit."
  @spec put_hung(BB.Callback.name()) :: true
  def put_hung(name) do
    :ets.insert(@table, {{:hung, name}, now_ms() + @hung_ms})
  rescue
    ArgumentError -> true
  end

  @doc "Returns whether to log a function's failure: `true` for one caller in ten minutes."
  @spec log?(BB.Callback.name()) :: boolean()
  def log?(name) do
    now_ms = now_ms()
    until_ms = now_ms + @log_interval_ms
    :ets.insert_new(@table, {{:logged, name}, until_ms}) or renew?(name, now_ms, until_ms)
  rescue
    ArgumentError -> true
  end

  # Of several callers, one replaces an expired row.
  defp renew?(name, now_ms, until_ms) do
    row = {{{:const, {:logged, name}}, until_ms}}
    expired = {{{:logged, name}, :"$1"}, [{:"=<", :"$1", now_ms}], [row]}
    :ets.select_replace(@table, [expired]) == 1
  end

  @doc """
  Forgets the failures of a function, so that its next one is logged. Tests use it.
  """
  @spec forget(BB.Callback.name()) :: :ok
  def forget(name) do
    for kind <- [:hung, :logged], do: :ets.delete(@table, {kind, name})
    :ok
  rescue
    ArgumentError -> :ok
  end

  defp now_ms, do: System.monotonic_time(:millisecond)
end

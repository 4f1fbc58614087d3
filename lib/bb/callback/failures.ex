defmodule BB.Callback.Failures do
  @moduledoc """
  What `BB.Callback` remembers of functions that failed: which did not return, and of which it was
  said.

  A table that belongs to the process that calls `create/0`: the application's own. Without it
  nothing is remembered.
  """

  @table __MODULE__
  @avoid_ms 60_000
  @quiet_ms 600_000

  @doc "Makes the table, unless it is there."
  @spec create() :: :ok
  def create do
    if :ets.whereis(@table) == :undefined,
      do: @table = :ets.new(@table, [:named_table, :public, read_concurrency: true])

    :ok
  end

  @doc "Whether a function did not return when it was called in the last minute."
  @spec hung?(BB.Callback.name()) :: boolean()
  def hung?(name) do
    :ets.lookup_element(@table, {:hung, name}, 2) > now_ms()
  rescue
    # It is not in the table, or there is none.
    ArgumentError -> false
  end

  @doc "Remembers that a function did not return."
  @spec put_hung(BB.Callback.name()) :: true
  def put_hung(name) do
    :ets.insert(@table, {{:hung, name}, now_ms() + @avoid_ms})
  rescue
    ArgumentError -> true
  end

  @doc "Whether a function's failure is to be said: true for one caller in ten minutes."
  @spec news?(BB.Callback.name()) :: boolean()
  def news?(name) do
    now_ms = now_ms()
    until_ms = now_ms + @quiet_ms
    :ets.insert_new(@table, {{:said, name}, until_ms}) or said_anew?(name, now_ms, until_ms)
  rescue
    ArgumentError -> true
  end

  # One caller alone replaces what has run out.
  defp said_anew?(name, now_ms, until_ms) do
    row = {{{:const, {:said, name}}, until_ms}}
    over = {{{:said, name}, :"$1"}, [{:"=<", :"$1", now_ms}], [row]}
    :ets.select_replace(@table, [over]) == 1
  end

  @doc """
  Forgets a function's failures, so that the next one is new: for its tests, and once it was
  mended.
  """
  @spec forget(BB.Callback.name()) :: :ok
  def forget(name) do
    for kind <- [:hung, :said], do: :ets.delete(@table, {kind, name})
    :ok
  rescue
    ArgumentError -> :ok
  end

  defp now_ms, do: System.monotonic_time(:millisecond)
end

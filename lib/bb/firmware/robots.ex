defmodule BB.Firmware.Robots do
  @moduledoc """
  The robots of this VM, as safety knows them: for what concerns all of them, an update or a
  restart of the board.

  It answers also where safety is gone. Without its tables no robot is armed, since whatever acts
  asks them first.
  """

  alias BB.Safety
  alias BB.Safety.Records

  @doc "All robots that safety knows."
  @spec known() :: [module()]
  def known do
    if Records.running?(), do: Enum.map(Records.records(), & &1.robot), else: []
  rescue
    # The tables have just gone.
    ArgumentError -> []
  end

  @doc """
  The one state that stands for all of them: `:armed` if any is, then `:disarming`, then `:error`.

      iex> BB.Firmware.Robots.state([NoRobot])
      :disarmed
  """
  @spec state([module()]) :: Safety.state()
  def state(robots) do
    states = Enum.map(robots, &Safety.state/1)
    Enum.find([:armed, :disarming, :error], :disarmed, &(&1 in states))
  end

  @doc "Disarms them, all at once, each within `limit_ms`."
  @spec disarm([module()], pos_integer()) :: :ok
  def disarm(robots, limit_ms \\ 10_000) do
    refs = for robot <- robots, {_pid, ref} = spawn_monitor(Safety, :disarm, [robot]), do: ref
    until_ms = System.monotonic_time(:millisecond) + limit_ms

    Enum.each(refs, fn ref ->
      receive do
        {:DOWN, ^ref, :process, _pid, _reason} -> :ok
      after
        max(0, until_ms - System.monotonic_time(:millisecond)) ->
          Process.demonitor(ref, [:flush])
      end
    end)
  end
end

defmodule BB.Firmware.Robots do
  @moduledoc """
  All robots of this VM that safety knows. Updates and restarts of the board use it.

      BB.Firmware.Robots.disarm(BB.Firmware.Robots.known())

  The functions work without the tables of safety too: without them no robot is armed.
  """

  alias BB.Safety
  alias BB.Safety.Records

  @doc "Returns all robots that safety knows."
  @spec known() :: [module()]
  def known do
    if Records.running?(), do: Enum.map(Records.records(), & &1.robot), else: []
  rescue
    # The tables were deleted a moment ago.
    ArgumentError -> []
  end

  @doc """
  Returns the common state of robots: `:armed` if one is armed, else `:disarming`, else
  `:error`, else `:disarmed`.

      iex> BB.Firmware.Robots.state([NoRobot])
      :disarmed
  """
  @spec state([module()]) :: Safety.state()
  def state(robots) do
    states = Enum.map(robots, &Safety.state/1)
    Enum.find([:armed, :disarming, :error], :disarmed, &(&1 in states))
  end

  @doc """
  Returns those of the robots that are armed.

      iex> BB.Firmware.Robots.armed([NoRobot])
      []
  """
  @spec armed([module()]) :: [module()]
  def armed(robots), do: Enum.filter(robots, &Safety.armed?/1)

  @doc "Disarms robots, all at once, and waits at most `limit_ms`."
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

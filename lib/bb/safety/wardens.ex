defmodule BB.Safety.Wardens do
  @moduledoc """
  Calls the wardens of robots (`BB.Safety.Warden`), and starts them. `BB.Safety` and the
  supervisors of a robot use it.

  A warden may die during a call. The request is then repeated: the successor of the warden knows
  the result of the first attempt. The name of this module is also the registered name of the
  supervisor of all wardens.
  """
  @moduledoc no_example: "internal: BB.Safety is its interface"

  alias BB.Safety.{Record, Records, Supervisor, Warden}

  @retry_ms 5
  @patience_ms 10_000

  @doc """
  Watches the calling process as the `:root` or the `:topology` of a robot. Its end disarms the
  robot. A `:component` takes the place of the root when the robot has none, because the component
  was started alone.
  """
  @spec watch(module(), Warden.role()) :: :ok
  def watch(robot, role) do
    unless Records.running?(),
      do: raise("BB.Safety is not running; start the application :ganglion before a robot")

    pid = self()
    retry(fn _attempt -> start_and_watch(robot, role, pid) end)
  end

  @doc """
  Makes the calling process the voucher of a path. When it ends, the path inhibits arming, and an
  armed robot is disarmed.
  """
  @spec vouch(module(), [atom()]) :: :ok
  def vouch(robot, path) do
    pid = self()

    retry(fn _attempt ->
      unless Records.known?(robot), do: watch(robot, :component)
      GenServer.call(Warden.name(robot), {:vouch, path, pid}, :infinity)
    end)
  end

  @doc "Arms the robot."
  @spec arm(module()) :: :ok | {:error, term()}
  def arm(robot) do
    ref = make_ref()
    seen = with {:ok, epoch} <- Records.latest_epoch(robot), do: epoch
    request(robot, {:arm, ref, :first}, {:arm, ref, seen})
  end

  @doc "Disarms the robot, and returns when its handlers have returned."
  @spec disarm(module(), pos_integer()) :: :ok | {:error, term()}
  def disarm(robot, timeout_ms), do: request(robot, {:disarm, make_ref(), timeout_ms})

  @doc "Moves a robot from `:error` to `:disarmed`."
  @spec force_disarm(module()) :: :ok | {:error, term()}
  def force_disarm(robot), do: request(robot, {:force_disarm, make_ref()})

  @doc """
  Disarms an armed robot and moves it to `:error`, and waits for a disarming in progress. Returns
  `:ok` for a robot in `:error`.
  """
  @spec fail(module()) :: :ok | {:error, term()}
  def fail(robot), do: request(robot, :fail)

  @doc """
  Announces that a root supervisor stops its children: the end of its topology supervisor is not a
  failure.
  """
  @spec announce_stop(module(), root :: pid()) :: :ok | {:error, :not_registered}
  def announce_stop(robot, root), do: request(robot, {:stopping, root})

  @doc """
  Disarms a robot that was armed before a moment, and waits for a disarming in progress. A robot
  that was armed later stays armed.
  """
  @spec secure(module(), Warden.moment()) :: :ok | {:error, term()}
  def secure(robot, moment \\ Warden.moment()), do: request(robot, {:secure, moment})

  @doc "Starts the warden of a robot with a record, unless it runs."
  @spec resume(Record.t()) :: :ok
  def resume(%{robot: robot}) do
    retry(fn _attempt ->
      _ = start(robot, :nobody, nil)
      :ok
    end)
  end

  # A warden with a record takes no role at its start, which may be a repeated start.
  defp start_and_watch(robot, role, pid) do
    _ = start(robot, role, pid)
    GenServer.call(Warden.name(robot), {:watch, role, pid}, :infinity)
  end

  defp start(robot, role, pid),
    do: DynamicSupervisor.start_child(__MODULE__, {Warden, {robot, role, pid}})

  # The successor of a warden that dies gets the request again, and knows its result.
  defp request(robot, request), do: request(robot, request, request)

  defp request(robot, request, again) do
    retry(fn attempt ->
      if Records.known?(robot),
        do:
          GenServer.call(
            Warden.name(robot),
            if(attempt == 1, do: request, else: again),
            :infinity
          ),
        else: {:error, :not_registered}
    end)
  end

  defp retry(fun), do: retry(fun, 1, System.monotonic_time(:millisecond) + @patience_ms)

  defp retry(fun, attempt, until_ms) do
    fun.(attempt)
  catch
    :exit, reason ->
      if System.monotonic_time(:millisecond) > until_ms, do: exit(reason)
      Process.sleep(@retry_ms)
      Supervisor.start()
      retry(fun, attempt + 1, until_ms)
  end
end

defmodule BB.Firmware.Applications.Restarter do
  @moduledoc """
  The process behind `BB.Firmware.Applications`: it belongs to no application, hears of ends, and
  does what `BB.Firmware.Applications.RestartPolicy` says.

  What it starts is everything that the release starts and that does not run, in the release's
  order, so that what could not start without an application that had ended comes back with it.

  Before it restarts the board it waits for an upload that is under way, and disarms the robots.
  How often it has restarted the board is kept in `restarts.txt` in the guard's folder, until
  everything has run for a while. A board that stays up without an application tells the watchdog
  that it has come up, for otherwise that would restart it in the midst of an update.
  """

  use GenServer
  use BB.Process.Tolerant

  require Logger

  alias BB.Firmware.{Attempt, Board, Gate, Guard, Kept, Robots, Story, Trial}
  alias BB.Firmware.Applications.RestartPolicy

  @first "ganglion restarts 1\n"
  @start_limit_ms 60_000
  @boot_ms 500
  @boot_limit_ms 120_000
  @upload_ms 5_000
  @upload_limit_ms 1_800_000
  @own [:name, :board, :folder, :expected, :gate]

  @doc """
  Starts it, linked to nobody. Options: those of `BB.Firmware.Applications.RestartPolicy.new/1`;
  `name:`; `board:` and `folder:` of the guard, without which they are the configured ones;
  `expected:` the applications that have to run, without which they are those of the release;
  `gate:` that of updates.
  """
  @spec start(keyword()) :: GenServer.on_start()
  def start(opts), do: GenServer.start(__MODULE__, opts, Keyword.take(opts, [:name]))

  @doc "Something happened to an application."
  @spec tell(GenServer.server(), {:started, atom()} | {:ended, atom(), term()}) :: :ok
  def tell(restarter, event), do: GenServer.cast(restarter, event)

  @impl GenServer
  def init(opts) do
    # The end of an application ends all processes of its group.
    Process.group_leader(self(), Process.whereis(:init))
    {own, policy} = Keyword.split(opts, @own)

    state = %{
      board: own[:board] || Board.configured(),
      folder: own[:folder] || Guard.folder(),
      expected: own[:expected],
      gate: own[:gate] || Gate,
      policy: new_policy(policy),
      stopped: MapSet.new(),
      ended: MapSet.new(),
      timer: nil,
      leaving?: false,
      stays_for: nil,
      began_ms: now_ms(),
      calm: nil
    }

    {:ok, calm(state)}
  end

  # A wrong option must not cost the board its restarter.
  defp new_policy(opts) do
    RestartPolicy.new(opts)
  rescue
    error ->
      Logger.error("#{inspect(BB.Firmware.Applications)}: #{Exception.message(error)}")
      RestartPolicy.new([])
  end

  @impl GenServer
  def handle_cast({:started, app}, state) do
    _ = if app in state.ended, do: Story.tell(state.folder, "the application #{app} runs again")

    {:noreply,
     %{
       state
       | stopped: MapSet.delete(state.stopped, app),
         ended: MapSet.delete(state.ended, app),
         stays_for: nil
     }}
  end

  # The machine goes down, and its applications with it.
  def handle_cast({:ended, _app, _reason}, %{leaving?: true} = state), do: {:noreply, state}

  def handle_cast({:ended, app, reason}, state) do
    {policy, step} = RestartPolicy.ended(state.policy, app, reason, now_ms())
    # Somebody has started it since it was stopped.
    stopped = MapSet.delete(state.stopped, app)
    state = calm(%{state | policy: policy, stopped: stopped})
    {:noreply, step(step, app, reason, state)}
  end

  @impl GenServer
  def handle_info(:start, state) do
    if booted?(state),
      do: {:noreply, start_all(%{state | timer: nil})},
      else: {:noreply, again(state)}
  end

  def handle_info({:last_step, app, reason, until_ms}, state),
    do: {:noreply, last(app, reason, until_ms, state)}

  # The board has refused to go.
  def handle_info(:still_here, state),
    do: {:noreply, start_in(%{state | leaving?: false}, RestartPolicy.stay_ms(state.policy))}

  def handle_info({:calm, calm}, %{calm: calm} = state) do
    _ = Kept.remove(file(state.folder))
    {:noreply, state}
  end

  defp step(:nothing, app, _reason, state) do
    _ = Story.tell(state.folder, "the application #{app} was stopped by a person")
    %{state | stopped: MapSet.put(state.stopped, app), ended: MapSet.delete(state.ended, app)}
  end

  defp step({:start, n, pause_ms}, app, reason, state) do
    of = RestartPolicy.starts(state.policy)
    _ = told(state, app, reason, "it is started again (#{n} of #{of})")
    start_in(%{state | ended: MapSet.put(state.ended, app)}, pause_ms)
  end

  defp step(:give_up, app, reason, state) do
    state = %{state | ended: MapSet.put(state.ended, app)}
    last(app, reason, now_ms() + @upload_limit_ms, state)
  end

  # Nothing goes before an update, which may be what helps.
  defp last(app, reason, until_ms, state) do
    if Gate.busy?(state.gate) and now_ms() < until_ms do
      _ = Process.send_after(self(), {:last_step, app, reason, until_ms}, @upload_ms)
      state
    else
      on_trial? = Trial.status(state.folder, state.board) == :unvalidated
      restarts = restarts(state.folder)

      act(
        RestartPolicy.last_step(state.policy, restarts, on_trial?),
        app,
        reason,
        restarts,
        state
      )
    end
  end

  defp act(:revert, app, reason, _restarts, state) do
    why = told(state, app, reason, "that does not help, and the firmware is on trial")
    leave(state, &Trial.revert(state.folder, &1, "the restarter of its applications", [why]))
  end

  defp act(:restart_board, app, reason, restarts, state) do
    case Kept.write(file(state.folder), @first <> "#{restarts + 1}\n") do
      :ok ->
        _ =
          told(
            state,
            app,
            reason,
            "that does not help; the board restarts (time #{restarts + 1})"
          )

        leave(state, &Board.reboot/1)

      # It could go on for ever, and nobody would know.
      {:error, _posix} ->
        act({:stay, RestartPolicy.stay_ms(state.policy)}, app, reason, :unknown, state)
    end
  end

  defp act({:stay, pause_ms}, app, reason, restarts, state) do
    _ =
      told(state, app, reason, "no restart helps (#{restarts}); the board stays up for an update")

    # Where it is not known how often it has restarted, the watchdog is left to do it.
    _ = if is_integer(restarts), do: Board.init_complete(state.board)
    start_in(%{state | stays_for: {app, reason}}, pause_ms)
  end

  # It may never return.
  defp leave(state, fun) do
    %{board: board} = state
    restarter = self()

    _ =
      spawn(fn ->
        Robots.disarm(Robots.known())

        with {:error, reason} <- fun.(board) do
          Logger.error("the board did not restart: #{inspect(reason)}")
          send(restarter, :still_here)
        end
      end)

    %{state | leaving?: true}
  end

  defp told(state, app, reason, what) do
    text = "the application #{app} ended (#{Kept.line(reason)}); #{what}"

    # The same once a minute would leave no room for how it began.
    _ =
      if state.stays_for == {app, reason},
        do: Logger.warning(text),
        else: Story.tell(state.folder, text)

    text
  end

  # Starting

  defp start_in(%{timer: nil} = state, pause_ms),
    do: %{state | timer: Process.send_after(self(), :start, pause_ms)}

  # All are started at once, at the earliest of their times.
  defp start_in(%{timer: timer} = state, pause_ms) do
    case Process.read_timer(timer) do
      left_ms when is_integer(left_ms) and left_ms <= pause_ms ->
        state

      _later_or_gone ->
        _ = Process.cancel_timer(timer)
        start_in(%{state | timer: nil}, pause_ms)
    end
  end

  defp again(state), do: start_in(%{state | timer: nil}, @boot_ms)

  # While the release starts, everything that it starts is not yet missing. What the boot file has
  # told last counts: the VM itself is starting for as long as what its command line names
  # (`-run`) has not returned. An application whose start never returns does not keep the others
  # from theirs.
  defp booted?(state) do
    case :init.get_status() do
      {:starting, :started} -> true
      {:starting, _what} -> now_ms() - state.began_ms > @boot_limit_ms
      _started -> true
    end
  end

  # Whoever fails is told of as any other; who does not return is not.
  defp start_all(state) do
    running = for {app, _, _} <- Application.started_applications(@start_limit_ms), do: app

    for app <- expected(state), app not in running, app not in state.stopped do
      start = fn -> Application.ensure_all_started(app) end
      limits = [attempts: 1, limit_ms: @start_limit_ms]

      with :error <- Attempt.run("starting the application #{app}", start, limits),
           do: tell(self(), {:ended, app, :did_not_start_in_time})
    end

    state
  end

  defp expected(%{expected: nil} = state), do: Enum.uniq(release() ++ Enum.sort(state.ended))
  defp expected(%{expected: expected}), do: expected

  # Those that the release's boot file starts, in its order.
  defp release do
    {:ok, [[boot | _] | _]} = :init.get_argument(:boot)
    {:script, _name, steps} = :erlang.binary_to_term(File.read!("#{boot}.boot"))
    for {:apply, {:application, :start_boot, [app | _]}} <- steps, do: app
  rescue
    _no_release -> []
  end

  # What is kept

  defp restarts(folder) do
    with @first <> count <- Kept.read(file(folder), @first),
         {count, _rest} <- Integer.parse(count) do
      count
    else
      _none -> 0
    end
  end

  defp calm(state) do
    calm = make_ref()
    _ = Process.send_after(self(), {:calm, calm}, RestartPolicy.calm_ms(state.policy))
    %{state | calm: calm}
  end

  defp file(folder), do: Path.join(folder, "restarts.txt")
  defp now_ms, do: System.monotonic_time(:millisecond)
end

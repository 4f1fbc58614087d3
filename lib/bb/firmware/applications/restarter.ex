defmodule BB.Firmware.Applications.Restarter do
  @moduledoc """
  The process behind `BB.Firmware.Applications`: it starts applications again and restarts the
  board, as `BB.Firmware.Applications.RestartPolicy` decides. It belongs to no application.

  It starts all applications of the release that do not run, in the order of the release. So an
  application that could not start without an ended one starts with it.

  Before it restarts the board, it waits for an upload in progress, and disarms the robots. The
  file `restarts.txt` in the guard's folder counts the restarts of the board, until all
  applications have run for a while. A board that stays up without an application reports to the
  watchdog that its start is complete; otherwise the watchdog would restart it in the middle of
  an update.
  """
  @moduledoc no_example: "internal: BB.Firmware.Applications is its interface"

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
  Starts the process without a link.

  Options: the options of `BB.Firmware.Applications.RestartPolicy.new/1`; `name:`; `board:` and
  `folder:` of the guard (default: the configured ones); `expected:` the applications that must
  run (default: those of the release); `gate:` for updates.
  """
  @spec start(keyword()) :: GenServer.on_start()
  def start(opts), do: GenServer.start(__MODULE__, opts, Keyword.take(opts, [:name]))

  @doc "Handles the start or the end of an application."
  @spec handle_event(GenServer.server(), {:started, atom()} | {:ended, atom(), term()}) :: :ok
  def handle_event(restarter, event), do: GenServer.cast(restarter, event)

  @impl GenServer
  def init(opts) do
    # The end of an application kills all processes with its group leader.
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

    {:ok, restart_calm_timer(state)}
  end

  # A wrong option must not leave the board without a restarter.
  defp new_policy(opts) do
    RestartPolicy.new(opts)
  rescue
    error ->
      Logger.error("#{inspect(BB.Firmware.Applications)}: #{Exception.message(error)}")
      RestartPolicy.new([])
  end

  @impl GenServer
  def handle_cast({:started, app}, state) do
    _ = if app in state.ended, do: Story.add(state.folder, "the application #{app} runs again")

    {:noreply,
     %{
       state
       | stopped: MapSet.delete(state.stopped, app),
         ended: MapSet.delete(state.ended, app),
         stays_for: nil
     }}
  end

  # The board restarts, which ends its applications.
  def handle_cast({:ended, _app, _reason}, %{leaving?: true} = state), do: {:noreply, state}

  def handle_cast({:ended, app, reason}, state) do
    {policy, step} = RestartPolicy.handle_end(state.policy, app, reason, now_ms())
    # It was started again after it was stopped.
    stopped = MapSet.delete(state.stopped, app)
    state = restart_calm_timer(%{state | policy: policy, stopped: stopped})
    {:noreply, take_step(step, app, reason, state)}
  end

  @impl GenServer
  def handle_info(:start, state) do
    if booted?(state),
      do: {:noreply, start_all(%{state | timer: nil})},
      else: {:noreply, start_later(state)}
  end

  def handle_info({:last_step, app, reason, until_ms}, state),
    do: {:noreply, take_last_step(app, reason, until_ms, state)}

  # The board did not restart.
  def handle_info(:not_restarted, state),
    do: {:noreply, start_in(%{state | leaving?: false}, RestartPolicy.stay_ms(state.policy))}

  def handle_info({:calm, calm}, %{calm: calm} = state) do
    _ = Kept.remove(file(state.folder))
    {:noreply, state}
  end

  defp take_step(:nothing, app, _reason, state) do
    _ = Story.add(state.folder, "the application #{app} was stopped by a person")
    %{state | stopped: MapSet.put(state.stopped, app), ended: MapSet.delete(state.ended, app)}
  end

  defp take_step({:start, n, pause_ms}, app, reason, state) do
    of = RestartPolicy.starts(state.policy)
    _ = add_to_story(state, app, reason, "start #{n} of #{of} follows")
    start_in(%{state | ended: MapSet.put(state.ended, app)}, pause_ms)
  end

  defp take_step(:give_up, app, reason, state) do
    state = %{state | ended: MapSet.put(state.ended, app)}
    take_last_step(app, reason, now_ms() + @upload_limit_ms, state)
  end

  # An update goes first, because it may repair the application.
  defp take_last_step(app, reason, until_ms, state) do
    if Gate.busy?(state.gate) and now_ms() < until_ms do
      _ = Process.send_after(self(), {:last_step, app, reason, until_ms}, @upload_ms)
      state
    else
      on_trial? = Trial.status(state.folder, state.board) == :unvalidated
      restarts = restarts(state.folder)

      execute(
        RestartPolicy.last_step(state.policy, restarts, on_trial?),
        app,
        reason,
        restarts,
        state
      )
    end
  end

  defp execute(:revert, app, reason, _restarts, state) do
    why = add_to_story(state, app, reason, "starts do not help, and the firmware is on trial")

    leave_board(
      state,
      &Trial.revert(state.folder, &1, "the restarter of its applications", [why])
    )
  end

  defp execute(:restart_board, app, reason, restarts, state) do
    case Kept.write(file(state.folder), @first <> "#{restarts + 1}\n") do
      :ok ->
        _ =
          add_to_story(
            state,
            app,
            reason,
            "starts do not help; the board restarts (time #{restarts + 1})"
          )

        leave_board(state, &Board.reboot/1)

      # The board could restart for ever, because its restarts cannot be counted.
      {:error, _posix} ->
        execute({:stay, RestartPolicy.stay_ms(state.policy)}, app, reason, :unknown, state)
    end
  end

  defp execute({:stay, pause_ms}, app, reason, restarts, state) do
    _ =
      add_to_story(
        state,
        app,
        reason,
        "restarts do not help (#{restarts}); the board stays up for an update"
      )

    # The watchdog restarts the board when the number of its restarts is unknown.
    _ = if is_integer(restarts), do: Board.init_complete(state.board)
    start_in(%{state | stays_for: {app, reason}}, pause_ms)
  end

  # Runs `fun` in a process of its own, because it may never return.
  defp leave_board(state, fun) do
    %{board: board} = state
    restarter = self()

    _ =
      spawn(fn ->
        Robots.disarm(Robots.known())

        with {:error, reason} <- fun.(board) do
          Logger.error("the board did not restart: #{inspect(reason)}")
          send(restarter, :not_restarted)
        end
      end)

    %{state | leaving?: true}
  end

  defp add_to_story(state, app, reason, action) do
    text = "the application #{app} ended (#{Kept.line(reason)}); #{action}"

    # The same line once a minute would displace the lines about the cause.
    _ =
      if state.stays_for == {app, reason},
        do: Logger.warning(text),
        else: Story.add(state.folder, text)

    text
  end

  # Starting

  defp start_in(%{timer: nil} = state, pause_ms),
    do: %{state | timer: Process.send_after(self(), :start, pause_ms)}

  # One start serves all applications, at the earliest of their times.
  defp start_in(%{timer: timer} = state, pause_ms) do
    case Process.read_timer(timer) do
      left_ms when is_integer(left_ms) and left_ms <= pause_ms ->
        state

      _later_or_expired ->
        _ = Process.cancel_timer(timer)
        start_in(%{state | timer: nil}, pause_ms)
    end
  end

  defp start_later(state), do: start_in(%{state | timer: nil}, @boot_ms)

  # While the release starts, no application is missing yet. The last step of the boot file
  # counts, because the status of the VM stays :starting until the command line (`-run`) has
  # returned. An application whose start never returns does not delay the others for ever.
  defp booted?(state) do
    case :init.get_status() do
      {:starting, :started} -> true
      {:starting, _step} -> now_ms() - state.began_ms > @boot_limit_ms
      _started -> true
    end
  end

  # Shoehorn reports a failed start as any end, but not a start that does not return.
  defp start_all(state) do
    running = for {app, _, _} <- Application.started_applications(@start_limit_ms), do: app

    for app <- expected(state), app not in running, app not in state.stopped do
      start = fn -> Application.ensure_all_started(app) end
      limits = [attempts: 1, limit_ms: @start_limit_ms]

      with :error <- Attempt.run("start the application #{app}", start, limits),
           do: handle_event(self(), {:ended, app, :did_not_start_in_time})
    end

    state
  end

  defp expected(%{expected: nil} = state), do: Enum.uniq(release() ++ Enum.sort(state.ended))
  defp expected(%{expected: expected}), do: expected

  # The applications in the boot file of the release, in its order.
  defp release do
    {:ok, [[boot | _] | _]} = :init.get_argument(:boot)
    {:script, _name, steps} = :erlang.binary_to_term(File.read!("#{boot}.boot"))
    for {:apply, {:application, :start_boot, [app | _]}} <- steps, do: app
  rescue
    _no_release -> []
  end

  # The count of restarts

  defp restarts(folder) do
    with @first <> count <- Kept.read(file(folder), @first),
         {count, _rest} <- Integer.parse(count) do
      count
    else
      _none -> 0
    end
  end

  defp restart_calm_timer(state) do
    calm = make_ref()
    _ = Process.send_after(self(), {:calm, calm}, RestartPolicy.calm_ms(state.policy))
    %{state | calm: calm}
  end

  defp file(folder), do: Path.join(folder, "restarts.txt")
  defp now_ms, do: System.monotonic_time(:millisecond)
end

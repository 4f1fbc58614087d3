defmodule BB.Firmware.Guard do
  @moduledoc """
  Validates new firmware if the robot works with it, and reverts it otherwise. Use it on boards;
  `BB.Firmware.Supervisor` starts it with the configured options.

      config :ganglion, BB.Firmware.Guard, stability_ms: 30_000, reach: :internet

  A board starts an update once, and reverts to the previous firmware unless the new one is
  validated. The guard validates firmware when all of these checks hold for the stability
  window, without a break:

    * each sensor with `required: true` has published fresh readings, as fresh as its
      `max_silence` and its rate allow,
    * native processes, outlets and inlets are up and were not started again,
    * a message on the pubsub and a message on the ring have returned to the guard,
    * the network has the required reach.

  Otherwise, at the deadline, the guard writes the reasons to its findings
  (`BB.Firmware.Trial.Findings`), and the board reverts. Sensors that are not required may be
  absent; the findings and the log mention them.

  Validated firmware stays as it is. On a board without validation (x86_64), an update through the
  gate is on trial too, by a marker (`BB.Firmware.Trial`), and only the guard reverts it. The
  marker also records the checks that the guard waits for, which gives a reason when the trial
  ends before the guard reverts.

  `BB.Firmware.Guard.Validation` decides, and this process acts. The deadline counts from the
  start of the VM, so that a guard that crashes repeatedly reverts too. When the guard does not
  run at all, the heart stops (`BB.Firmware.Guard.Heart`) and the board restarts.

  Nerves has a guard of its own, which validates as soon as all applications have started.
  Disable it (`config :nerves_runtime, startup_guard_enabled: false`); this guard also reports
  to the watchdog.

  ## Options

  #{BB.Options.docs(BB.Firmware.Guard.Options.schema(__MODULE__))}
  """

  use GenServer
  use BB.Process.Tolerant

  require Logger

  alias BB.Firmware.{Board, Story, Trial}
  alias BB.Firmware.Guard.{Checks, Heart, Options, Validation}
  alias BB.Firmware.Network.Adapter
  alias BB.Firmware.Trial.Findings

  @schema Options.schema(__MODULE__)
  @call_timeout_ms 1_000
  @note_ms 15_000
  @by "its guard"

  @typedoc """
  The state of a guard. `reasons` are the reasons for which the firmware is not validated,
  `missing` the sensors that are not required and not up, `left_ms` the time until the deadline,
  or `nil`.
  """
  @type state :: %{
          phase: Validation.phase(),
          status: Validation.status() | nil,
          reasons: [{Validation.check(), Validation.reason()}],
          missing: [{Validation.check(), String.t()}],
          left_ms: integer() | nil
        }

  @doc "Starts a guard. Raises `BB.Options.ValidationError` for wrong options."
  @spec start_link(keyword()) :: GenServer.on_start()
  def start_link(opts) do
    opts = BB.Options.validate!(opts, @schema)
    GenServer.start_link(__MODULE__, opts, name: opts[:name])
  end

  @doc "Returns the state of a guard: `{:ok, state}`, or `{:error, :not_running}`."
  @spec state(GenServer.server()) :: {:ok, state()} | {:error, :not_running}
  def state(guard \\ __MODULE__) do
    {:ok, GenServer.call(guard, :state, @call_timeout_ms)}
  catch
    :exit, _reason -> {:error, :not_running}
  end

  @doc "Returns the folder of the guard's files, from the configuration of the guard."
  @spec folder() :: Path.t()
  def folder,
    do: Keyword.get(Application.get_env(:ganglion, __MODULE__, []), :folder, Options.folder())

  @impl GenServer
  def init(opts) do
    # So that terminate/2 runs, which closes the topic.
    Process.flag(:trap_exit, true)

    checks =
      Checks.new(opts[:robot],
        topic: topic(opts[:robot], opts[:topic]),
        network: opts[:network] || Adapter.configured(),
        reach: opts[:reach],
        fresh_ms: opts[:fresh_ms]
      )

    validation =
      Validation.new(
        required: Checks.required(checks),
        stability_ms: opts[:stability_ms],
        fresh_ms: opts[:fresh_ms],
        deadline_ms: (opts[:started_ms] || vm_started_ms()) + opts[:deadline_ms]
      )

    state = %{
      board: opts[:board] || Board.configured(),
      folder: opts[:folder],
      poll_ms: opts[:poll_ms],
      checks: checks,
      validation: validation,
      noted_ms: nil
    }

    {:ok, state, {:continue, :check}}
  end

  # A name that is too long with the topic prefix is used without it.
  defp topic(robot, name) do
    case BB.Topic.of(robot, name) do
      {:ok, topic} -> topic
      {:error, _why} -> name
    end
  end

  @impl GenServer
  def handle_continue(:check, state), do: {:noreply, check(state)}

  @impl GenServer
  def handle_info(:check, state), do: {:noreply, check(state)}

  def handle_info(message, state) do
    if Validation.over?(state.validation),
      do: {:noreply, state},
      else:
        {:noreply,
         Enum.reduce(Checks.handle_message(state.checks, message), state, &handle_event/2)}
  end

  @impl GenServer
  def handle_call(:state, _from, state) do
    validation = state.validation
    watching? = validation.phase in [:watching, :validating]

    {:reply,
     %{
       phase: validation.phase,
       status: validation.status,
       reasons: if(watching?, do: Validation.reasons(validation, now_ms()), else: []),
       missing: Checks.missing(state.checks),
       left_ms: if(watching?, do: validation.deadline_ms - now_ms())
     }, state}
  end

  @impl GenServer
  def terminate(_reason, state), do: Checks.close(state.checks)

  # Checks end when the validation is over.
  defp check(state) do
    state = read_status(state)
    if Validation.over?(state.validation), do: close_checks(state), else: run_checks(state)
  end

  defp close_checks(state), do: %{state | checks: Checks.close(state.checks)}

  defp run_checks(state) do
    _ = Process.send_after(self(), :check, state.poll_ms)
    {checks, events} = Checks.run(state.checks)
    Enum.reduce(events ++ [:tick], %{state | checks: checks}, &handle_event/2)
  end

  # Begins the trial again, in case the board did not answer during the start.
  defp read_status(%{validation: %{phase: :asking}} = state) do
    _ = Trial.begin(state.folder, state.board)
    handle_event({:status, Trial.status(state.folder, state.board)}, state)
  end

  defp read_status(state), do: write_notes(state, now_ms())

  defp write_notes(%{noted_ms: noted_ms} = state, now_ms)
       when is_integer(noted_ms) and now_ms - noted_ms < @note_ms,
       do: state

  defp write_notes(state, now_ms) do
    waits =
      for reason <- Validation.reasons(state.validation, now_ms),
          do: "required: " <> format_reason(reason)

    left_s = div(state.validation.deadline_ms - now_ms, 1_000)
    _ = Trial.put_notes(state.folder, ["the guard had #{left_s} s left" | waits])
    %{state | noted_ms: now_ms}
  end

  defp format_reason({check, reason}),
    do: "#{Findings.format_check(check)}: #{Findings.format_reason(reason)}"

  defp handle_event(event, state) do
    {validation, effects} = Validation.handle(state.validation, event, now_ms())
    Enum.reduce(effects, %{state | validation: validation}, &execute/2)
  end

  defp execute(:set_heart, state) do
    :ok = Heart.wind(state.validation.deadline_ms)
    log_error(Board.set_heart(state.board, Heart.callback()), "set the callback of the heart")
    state
  end

  defp execute(:clear_heart, state) do
    log_error(Board.clear_heart(state.board, Heart.callback()), "clear the callback of the heart")
    write_findings(state, :validated)
    _ = Story.add(state.folder, "the firmware #{version(state)} works: it is validated")
    state
  end

  defp execute(:init_complete, state) do
    log_error(Board.init_complete(state.board), "report the start to the watchdog")
    state
  end

  defp execute(:validate, state) do
    result = Trial.validate(state.folder, state.board)
    log_error(result, "validate the firmware, which works")
    handle_event({:validation, result}, state)
  end

  # Reverts in a process of its own, because the call may never return.
  defp execute(:revert, state) do
    write_findings(state, :reverted)

    reasons =
      Enum.map_join(Validation.reasons(state.validation, now_ms()), "; ", &format_reason/1)

    _ = Trial.put_verdict(state.folder, @by)

    _ =
      Story.add(state.folder, "the firmware #{version(state)} is reverted by #{@by}: #{reasons}")

    board = state.board
    {:ok, _} = Task.start(fn -> log_error(Board.revert(board), "revert the firmware") end)
    state
  end

  defp write_findings(state, outcome) do
    findings = %{
      outcome: outcome,
      by: if(outcome == :reverted, do: @by),
      at: DateTime.utc_now(),
      firmware: Board.firmware(state.board),
      reasons:
        if(outcome == :reverted, do: Validation.reasons(state.validation, now_ms()), else: []),
      missing: Checks.missing(state.checks)
    }

    if outcome == :reverted or findings.missing != [], do: Logger.warning(Findings.text(findings))
    log_error(Findings.write(state.folder, findings), "write the findings to #{state.folder}")
  end

  defp version(state), do: Board.firmware(state.board)["nerves_fw_version"] || "that runs"

  defp log_error(:ok, _action), do: :ok

  defp log_error({:error, reason}, action),
    do: Logger.error("could not #{action}: #{inspect(reason)}")

  defp now_ms, do: System.monotonic_time(:millisecond)

  defp vm_started_ms,
    do: System.convert_time_unit(:erlang.system_info(:start_time), :native, :millisecond)
end

defmodule BB.Firmware.Guard do
  @folder "/data/guard"

  @schema BB.Options.new!(
            robot: [type: :module, required: true, doc: "The robot that has to work."],
            name: [type: :any, default: __MODULE__, doc: "The name of the process."],
            board: [
              type: {:tuple, [:module, :any]},
              doc: "`BB.Firmware.Board`; the configured one."
            ],
            network: [
              type: {:tuple, [:module, :any]},
              doc: "`BB.Firmware.Network.Adapter`; the configured one."
            ],
            reach: [
              type: {:in, [:none, :lan, :internet]},
              default: :lan,
              doc: "How far the network has to reach; `:none` for not at all."
            ],
            stability_ms: [
              type: :non_neg_integer,
              default: 10_000,
              doc: "How long everything has to be good without a break, in milliseconds."
            ],
            deadline_ms: [
              type: :pos_integer,
              default: 300_000,
              doc: "Milliseconds from the VM's start to the revert."
            ],
            fresh_ms: [
              type: :pos_integer,
              default: 1_000,
              doc: "How old a sample may be, and how long a check may say nothing."
            ],
            poll_ms: [type: :pos_integer, default: 250, doc: "Milliseconds between two looks."],
            folder: [type: :string, default: @folder, doc: "Where reports are written."],
            topic: [
              type: :string,
              default: "firmware_guard",
              doc:
                "The ring topic for the round trip, for the guard alone, after the robot's prefix (`BB.Topic`)."
            ],
            started_ms: [type: :integer, doc: "When the VM was started, on the monotonic clock."]
          )

  @moduledoc """
  Keeps new firmware only if the robot works with it.

  A board starts an update once, and falls back to the firmware before it unless somebody validates the new one. This is that
  somebody. Firmware is validated when all of this is so, without a break, for the stability window:

    * each sensor that is declared with `required: true` has published fresh samples, as fresh as
      its `max_silence` and its rate allow,
    * native processes, outlets and inlets are up and were not started again,
    * a message on the pubsub and one on the ring came back to the guard,
    * the network reaches as far as wanted.

  Otherwise, at the deadline, the reasons are written to a report (`BB.Firmware.Trial.Findings`) and the board reverts. Sensors that are
  not required may be absent: the report and the log tell of them, no more.

  Nothing happens to firmware that is validated already. On a board that knows no such state
  (x86_64) an update that came in through the gate is on trial too, by a marker
  (`BB.Firmware.Trial`): the guard reverts it, and nothing else does. The marker gets what the
  guard waits for as well, so that there is a reason also where the guard has not come as far as
  to revert.

  `BB.Firmware.Guard.Validation` decides, this process acts. Its deadline counts from the start of the VM, so that a guard that crashes
  again and again decides too; when even the guard is gone, the heart stops (`BB.Firmware.Guard.Heart`) and the board restarts.

  Nerves has a guard of its own, which validates as soon as all applications have started. It has to be off
  (`config :nerves_runtime, startup_guard_enabled: false`); what it does for the watchdog, this one does.

  ## Options

  #{BB.Options.docs(@schema)}
  """

  use GenServer
  use BB.Process.Tolerant

  require Logger

  alias BB.Firmware.{Board, Story, Trial}
  alias BB.Firmware.Guard.{Checks, Heart, Validation}
  alias BB.Firmware.Network.Adapter
  alias BB.Firmware.Trial.Findings

  @call_timeout_ms 1_000
  @note_ms 15_000
  @by "its guard"

  @typedoc """
  How it stands. `reasons` are those for which the firmware is not validated, `missing` the sensors that are not required and not up,
  `left_ms` is how long the deadline is away, while there is one.
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

  @doc "How it stands: `{:ok, state}`, or `{:error, :not_running}`."
  @spec state(GenServer.server()) :: {:ok, state()} | {:error, :not_running}
  def state(guard \\ __MODULE__) do
    {:ok, GenServer.call(guard, :state, @call_timeout_ms)}
  catch
    :exit, _reason -> {:error, :not_running}
  end

  @doc "Returns the folder of the guard's files, from the configuration of the guard."
  @spec folder() :: Path.t()
  def folder, do: Keyword.get(Application.get_env(:ganglion, __MODULE__, []), :folder, @folder)

  @impl GenServer
  def init(opts) do
    # So that terminate/2 runs, and the topic ends with the guard.
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

    {:ok, state, {:continue, :look}}
  end

  # A name that is too long with the prefix is the guard's alone as well without it.
  defp topic(robot, name) do
    case BB.Topic.of(robot, name) do
      {:ok, topic} -> topic
      {:error, _why} -> name
    end
  end

  @impl GenServer
  def handle_continue(:look, state), do: {:noreply, look(state)}

  @impl GenServer
  def handle_info(:look, state), do: {:noreply, look(state)}

  def handle_info(message, state) do
    if Validation.over?(state.validation),
      do: {:noreply, state},
      else: {:noreply, Enum.reduce(Checks.heard(state.checks, message), state, &happen/2)}
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

  # It goes on looking only as long as something depends on it.
  defp look(state) do
    state = ask(state)
    if Validation.over?(state.validation), do: rest(state), else: look_again(state)
  end

  defp rest(state), do: %{state | checks: Checks.close(state.checks)}

  defp look_again(state) do
    _ = Process.send_after(self(), :look, state.poll_ms)
    {checks, events} = Checks.look(state.checks)
    Enum.reduce(events ++ [:tick], %{state | checks: checks}, &happen/2)
  end

  # Where the start could not look at the marker, as the board did not answer yet, it is done
  # here.
  defp ask(%{validation: %{phase: :asking}} = state) do
    _ = Trial.begin(state.folder, state.board)
    happen({:status, Trial.status(state.folder, state.board)}, state)
  end

  defp ask(state), do: note(state, now_ms())

  defp note(%{noted_ms: noted_ms} = state, now_ms)
       when is_integer(noted_ms) and now_ms - noted_ms < @note_ms,
       do: state

  defp note(state, now_ms) do
    waits =
      for reason <- Validation.reasons(state.validation, now_ms), do: "required: " <> said(reason)

    left_s = div(state.validation.deadline_ms - now_ms, 1_000)
    _ = Trial.note(state.folder, ["the guard had #{left_s} s left" | waits])
    %{state | noted_ms: now_ms}
  end

  defp said({check, reason}), do: "#{Findings.name(check)}: #{Findings.words(reason)}"

  defp happen(event, state) do
    {validation, effects} = Validation.handle(state.validation, event, now_ms())
    Enum.reduce(effects, %{state | validation: validation}, &act/2)
  end

  defp act(:set_heart, state) do
    :ok = Heart.wind(state.validation.deadline_ms)
    told(Board.set_heart(state.board, Heart.callback()), "the heart's callback was not set")
    state
  end

  defp act(:clear_heart, state) do
    told(Board.clear_heart(state.board, Heart.callback()), "the heart's callback was not cleared")
    report(state, :validated)
    _ = Story.tell(state.folder, "the firmware #{version(state)} works: it is validated")
    state
  end

  defp act(:init_complete, state) do
    told(Board.init_complete(state.board), "the watchdog was not told of the start")
    state
  end

  defp act(:validate, state) do
    result = Trial.validate(state.folder, state.board)
    told(result, "this firmware works, but validating it failed")
    happen({:validation, result}, state)
  end

  # It may never return.
  defp act(:revert, state) do
    report(state, :reverted)
    reasons = Enum.map_join(Validation.reasons(state.validation, now_ms()), "; ", &said/1)
    _ = Trial.verdict(state.folder, @by)

    _ =
      Story.tell(state.folder, "the firmware #{version(state)} is reverted by #{@by}: #{reasons}")

    board = state.board
    {:ok, _} = Task.start(fn -> told(Board.revert(board), "reverting failed") end)
    state
  end

  defp report(state, outcome) do
    report = %{
      outcome: outcome,
      by: if(outcome == :reverted, do: @by),
      at: DateTime.utc_now(),
      firmware: Board.firmware(state.board),
      reasons:
        if(outcome == :reverted, do: Validation.reasons(state.validation, now_ms()), else: []),
      missing: Checks.missing(state.checks)
    }

    if outcome == :reverted or report.missing != [], do: Logger.warning(Findings.text(report))
    told(Findings.write(state.folder, report), "no report was written to #{state.folder}")
  end

  defp version(state), do: Board.firmware(state.board)["nerves_fw_version"] || "that runs"

  defp told(:ok, _what), do: :ok
  defp told({:error, reason}, what), do: Logger.error("#{what}: #{inspect(reason)}")

  defp now_ms, do: System.monotonic_time(:millisecond)

  defp vm_started_ms,
    do: System.convert_time_unit(:erlang.system_info(:start_time), :native, :millisecond)
end

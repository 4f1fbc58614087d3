defmodule BB.Firmware.Gate do
  @schema BB.Options.new!(
            robot: [type: :module, required: true, doc: "The robot that must not be armed."],
            name: [type: :any, default: __MODULE__, doc: "The name of the process."],
            board: [
              type: {:tuple, [:module, :any]},
              doc: "`BB.Firmware.Board`; the configured one."
            ],
            public_key: [
              type: :string,
              default: "/etc/ganglion/firmware.pub",
              doc: "The file with the key that updates are signed for."
            ],
            settle_ms: [
              type: :non_neg_integer,
              default: 5_000,
              doc: "How long the gate stays closed after an upload, in milliseconds."
            ]
          )

  @moduledoc """
  Lets an update in, or tells the uploader why not.

  An update is refused while

    * the robot is armed or being disarmed,
    * the running firmware is not validated: it would have nothing to fall back to,
    * another update is written, or one was and the board is about to restart: the two would write to the same place,
    * the public key is missing: without a key `fwup` takes any image, signed or not,

  and also when this process is not there to decide. While an update is written the robot cannot be armed
  (`BB.Safety.inhibit/3` at `[:firmware, :update]`). After it was written, the robot is disarmed and the board restarted.

      config :ssh_subsystem_fwup,
        precheck_callback: {BB.Firmware.Gate, :precheck, []},
        success_callback: {BB.Firmware.Gate, :written, []}

  ## Options

  #{BB.Options.docs(@schema)}
  """

  use GenServer

  require Logger

  alias BB.Firmware.Board
  alias BB.Firmware.Gate.{Decision, Lock}
  alias BB.Safety

  @path [:firmware, :update]
  @call_timeout_ms 10_000

  @doc "Starts the gate. Raises `BB.Options.ValidationError` for wrong options."
  @spec start_link(keyword()) :: GenServer.on_start()
  def start_link(opts) do
    opts = BB.Options.validate!(opts, @schema)
    GenServer.start_link(__MODULE__, opts, name: opts[:name])
  end

  @doc """
  Whether the calling process may write an update: `{:ok, options}` for `SSHSubsystemFwup`, or `{:error, text}`, which it shows to who
  uploads. From then on the caller holds the gate, until it ends.
  """
  @spec precheck(GenServer.server()) :: {:ok, keyword()} | {:error, String.t()}
  def precheck(gate \\ __MODULE__) do
    with {:error, text} <- GenServer.call(gate, {:enter, self()}, @call_timeout_ms) do
      # The uploader's terminal shows it as it is.
      {:error, text <> "\n"}
    end
  catch
    :exit, _reason -> {:error, "the gate for updates does not answer\n"}
  end

  @doc "Called when an update was written: disarms the robot and restarts the board, also when the gate itself is gone."
  @spec written(GenServer.server()) :: :ok | {:error, term()}
  def written(gate \\ __MODULE__) do
    {robot, board} = GenServer.call(gate, :written, @call_timeout_ms)
    _ = disarm(robot)
    Board.reboot(board)
  catch
    :exit, _reason -> Board.reboot(Board.configured())
  end

  @impl GenServer
  def init(opts) do
    state = %{
      robot: opts[:robot],
      board: opts[:board] || Board.configured(),
      key: opts[:public_key],
      settle_ms: opts[:settle_ms],
      holder_name: holder_name(opts[:name]),
      lock: :free
    }

    {:ok, take_over(state)}
  end

  @impl GenServer
  def handle_call({:enter, holder}, _from, state) do
    state = %{state | lock: Lock.passed(state.lock, now_ms())}

    case enter(state, holder) do
      {:ok, lock} -> {:reply, {:ok, options(state)}, hold(%{state | lock: lock}, holder)}
      {:error, text} -> {:reply, refuse(state, text), state}
    end
  end

  def handle_call(:written, _from, state),
    do: {:reply, {state.robot, state.board}, %{state | lock: Lock.written(state.lock)}}

  @impl GenServer
  def handle_info({:DOWN, _ref, :process, pid, _reason}, state) do
    _ = Process.send_after(self(), :passed, state.settle_ms)
    {:noreply, %{state | lock: Lock.left(state.lock, pid, now_ms(), state.settle_ms)}}
  end

  def handle_info(:passed, state) do
    lock = Lock.passed(state.lock, now_ms())
    _ = if lock == :free, do: Safety.allow(state.robot, @path)
    {:noreply, %{state | lock: lock}}
  end

  # First nobody can arm the robot, then it is seen whether it is armed.
  defp enter(state, holder) do
    lock = Lock.enter(state.lock, holder, now_ms())
    _ = if match?({:ok, _}, lock), do: Safety.inhibit(state.robot, @path, :update)

    facts = %{
      lock: with({:ok, _} <- lock, do: :ok),
      key: key(state.key),
      validation: Board.validation_status(state.board),
      safety: Safety.state(state.robot)
    }

    with :ok <- Decision.decide(facts), do: lock
  end

  defp refuse(state, text) do
    _ = if state.lock == :free, do: Safety.allow(state.robot, @path)
    Logger.warning("an update was refused: #{text}")
    {:error, text}
  end

  defp options(state), do: [fwup_extra_options: ["--public-key-file", state.key]]

  # The name of the holder outlives this process, so that a gate that was killed finds whom it has let in.
  defp hold(state, holder) do
    _ = Process.monitor(holder)
    _ = name(holder, state.holder_name)
    state
  end

  defp name(pid, name) do
    Process.register(pid, name)
  rescue
    # It has ended already, or has a name of its own.
    ArgumentError -> false
  end

  defp take_over(state) do
    case Process.whereis(state.holder_name) do
      nil ->
        Safety.allow(state.robot, @path)
        state

      holder ->
        _ = Process.monitor(holder)
        %{state | lock: {:held, holder}}
    end
  end

  defp holder_name(name) when is_atom(name) and name != nil, do: Module.concat(name, Holder)
  defp holder_name(_name), do: __MODULE__.Holder

  defp key(file) do
    case File.stat(file) do
      {:ok, %{type: :regular, size: size}} when size > 0 -> {:ok, file}
      {:ok, _other} -> {:error, {file, "is empty or no file"}}
      {:error, :enoent} -> {:error, {file, "is missing"}}
      {:error, posix} -> {:error, {file, "cannot be read (#{posix})"}}
    end
  end

  defp disarm(robot) do
    with {:error, reason} <- Safety.disarm(robot),
         do: Logger.info("before the restart: #{inspect(reason)}")
  end

  defp now_ms, do: System.monotonic_time(:millisecond)
end

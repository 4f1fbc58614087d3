defmodule BB.Firmware.Init do
  @moduledoc """
  Prepares `/data` in the start of a board, before ssh and before any other use. Configure it on
  boards with Nerves:

      config :nerves_runtime, init_module: BB.Firmware.Init

  In this order:

    1. it waits until the board answers (`c:BB.Firmware.Board.ready/1`),
    2. Nerves mounts `/data`, and makes a new file system if it cannot be mounted,
    3. damaged host keys are renamed (`BB.Firmware.HostKeys`),
    4. the trial of an update is recorded, and the outcome of the one before
    (`BB.Firmware.Trial`).

  No step can end the start: a step that raises or never returns is tried again and then skipped
  (`BB.Firmware.Attempt`). The readers of other files in `/data` check them. The host keys are
  checked here because ssh starts before this application and overwrites a key that it cannot
  read.
  """

  alias BB.Firmware.{Attempt, Board, Guard, HostKeys, Trial}
  alias Nerves.Runtime.Init

  # The module exists on boards alone, where the compiler checks the calls.
  unless Code.ensure_loaded?(Init), do: @compile({:no_warn_undefined, Init})

  # Enough time to make a file system on a large and slow card.
  @mount_limit_ms 180_000

  @doc false
  def child_spec(_opts),
    do: %{id: __MODULE__, start: {__MODULE__, :start_link, [[]]}, restart: :transient}

  @doc """
  Runs the steps and returns `:ignore`: it leaves no process.

  Options, for tests: `board:`, `folder:` of the guard, `keys:` the folder of the host keys,
  `mount:` a function that mounts `/data`, `attempt:` options of `BB.Firmware.Attempt.run/3`. The
  defaults are the configured ones.
  """
  @spec start_link(keyword()) :: :ignore
  def start_link(opts \\ []) do
    board = opts[:board] || Board.configured()
    folder = opts[:folder] || Guard.folder()
    mount = opts[:mount] || (&Init.init_application_partition/0)

    for {step, fun, limits} <- [
          {"wait for the board", fn -> Board.ready(board) end, [limit_ms: 120_000, attempts: 1]},
          {"mount /data", mount, [limit_ms: @mount_limit_ms]},
          {"check the host keys", fn -> HostKeys.set_aside_damaged(opts[:keys] || keys()) end,
           []},
          {"begin the trial", fn -> :ok = begin_trial(folder, board) end, []}
        ],
        do: _ = Attempt.run(step, fun, Keyword.merge(limits, opts[:attempt] || []))

    :ignore
  end

  # A board without known firmware has no trials.
  defp begin_trial(folder, board) do
    with {:error, :unknown_firmware} <- Trial.begin(folder, board), do: :ok
  end

  defp keys, do: Application.get_env(:nerves_ssh, :system_dir, "/data/nerves_ssh")
end

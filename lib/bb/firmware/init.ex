defmodule BB.Firmware.Init do
  @moduledoc """
  The first of ours in a board's start, before ssh: what has to happen to `/data` before anything
  there is used.

      config :nerves_runtime, init_module: BB.Firmware.Init

  In this order:

    1. it waits until the board can be asked (`c:BB.Firmware.Board.ready/1`),
    2. Nerves mounts `/data`, and makes a new file system where there is none that can be mounted,
    3. damaged host keys are set aside (`BB.Firmware.HostKeys`),
    4. an update on trial is noted, and what became of the one before (`BB.Firmware.Trial`).

  No step can end the start: whatever it raises, and also when it never returns, it is tried again
  and then left out (`BB.Firmware.Attempt`). Other files of ours in `/data` are looked at by who
  reads them. The host keys belong to an application that starts before this one, and does not
  keep what it cannot read.
  """

  alias BB.Firmware.{Attempt, Board, Guard, HostKeys, Trial}
  alias Nerves.Runtime.Init

  # It is there on boards alone, and there the compiler shall check what is called.
  unless Code.ensure_loaded?(Init), do: @compile({:no_warn_undefined, Init})

  # A file system is made within this, on a large and slow card.
  @mount_limit_ms 180_000

  @doc false
  def child_spec(_opts),
    do: %{id: __MODULE__, start: {__MODULE__, :start_link, [[]]}, restart: :transient}

  @doc """
  Does it, and leaves no process. It always returns `:ignore`.

  Options, for tests: `board:`, `folder:` of the guard, `keys:` the folder of the host keys,
  `mount:` what mounts, a function without arguments; `attempt:` options of
  `BB.Firmware.Attempt.run/3`. Without them all are the configured ones.
  """
  @spec start_link(keyword()) :: :ignore
  def start_link(opts \\ []) do
    board = opts[:board] || Board.configured()
    folder = opts[:folder] || Guard.folder()
    mount = opts[:mount] || (&Init.init_application_partition/0)

    for {what, fun, limits} <- [
          {"waiting for the board", fn -> Board.ready(board) end,
           [limit_ms: 120_000, attempts: 1]},
          {"mounting /data", mount, [limit_ms: @mount_limit_ms]},
          {"looking at the host keys",
           fn -> HostKeys.set_aside_damaged(opts[:keys] || keys()) end, []},
          {"looking at the trial", fn -> :ok = begun(folder, board) end, []}
        ],
        do: _ = Attempt.run(what, fun, Keyword.merge(limits, opts[:attempt] || []))

    :ignore
  end

  # A board that has no firmware to speak of has no trials.
  defp begun(folder, board) do
    with {:error, :unknown_firmware} <- Trial.begin(folder, board), do: :ok
  end

  defp keys, do: Application.get_env(:nerves_ssh, :system_dir, "/data/nerves_ssh")
end

defmodule BB.Firmware.Gate do
  @moduledoc """
  Accepts or refuses firmware updates. Configure it for the upload over ssh; other uploaders call
  `precheck/2` and `written/2`.

      config :ssh_subsystem_fwup,
        precheck_callback: {BB.Firmware.Gate, :precheck, []},
        success_callback: {BB.Firmware.Gate, :written, []}

  An update is refused while

    * a robot is armed or being disarmed,
    * the running firmware is not validated, because the board could not revert,
    * another update is written, or was written and the board is about to restart, because both
      would write to the same slot,
    * the public key is missing, because `fwup` without a key accepts any image.

  While an update is written, no robot can be armed (`BB.Safety.inhibit/3` at
  `[:firmware, :update]`). Then the robots are disarmed and the board restarts.

  ## Without the process

  `precheck/2` decides in the uploading process. The gate's process only has the robot and the
  options. When the application of a board does not run, an update may repair it. So the same
  rules hold without the process, with the options of `config :ganglion, BB.Firmware.Gate`. A
  process of no application has the lock (`BB.Firmware.Gate.LockServer`), and the tables of
  `BB.Safety` tell which robots are armed.

  ## Options

  #{BB.Options.docs(BB.Firmware.Gate.Options.schema(__MODULE__))}
  """

  use GenServer
  use BB.Process.Tolerant

  require Logger

  alias BB.Firmware.{Board, Guard, Robots, Story, Trial}
  alias BB.Firmware.Gate.{LockServer, Options, Precheck}

  @schema Options.schema(__MODULE__)
  @configured Options.configured()
  @call_timeout_ms 5_000

  @doc "Starts the gate. Raises `BB.Options.ValidationError` for wrong options."
  @spec start_link(keyword()) :: GenServer.on_start()
  def start_link(opts) do
    opts = BB.Options.validate!(opts, @schema)
    GenServer.start_link(__MODULE__, opts, name: opts[:name])
  end

  @doc """
  Decides whether the calling process may write an update. Returns `{:ok, options}` for
  `SSHSubsystemFwup`, or `{:error, text}` for the uploading person. After `{:ok, _}` the caller
  has the lock until it ends.

  `opts` are the options in case the gate does not run (default: the configured ones).
  """
  @spec precheck(GenServer.server(), keyword()) :: {:ok, keyword()} | {:error, String.t()}
  def precheck(gate \\ __MODULE__, opts \\ configured()) do
    with {:error, text} <- gate |> settings(opts) |> enter() do
      Logger.warning("update refused: #{text}")
      # The terminal of the uploading person shows the text unchanged.
      {:error, text <> "\n"}
    end
  rescue
    error -> refuse(Exception.message(error))
  catch
    kind, reason -> refuse(inspect({kind, reason}, limit: 20))
  end

  defp refuse(why) do
    Logger.error("update refused: the check of the update failed: #{why}")
    {:error, "the check of the update failed: #{why}\n"}
  end

  @doc """
  Disarms the robots and restarts the board, also when the gate does not run. The uploader calls
  it when an update was written.
  """
  @spec written(GenServer.server(), keyword()) :: :ok | {:error, term()}
  def written(gate \\ __MODULE__, opts \\ configured()) do
    settings = settings(gate, opts)
    prepare_restart(settings)
    Board.reboot(settings.board)
  end

  # The board restarts even if this fails.
  defp prepare_restart(settings) do
    LockServer.written(settings)
    Robots.disarm(settings.robots)
    _ = Trial.written(settings.folder)
    _ = Story.add(settings.folder, "an update was written; the board restarts with it")
    :ok
  rescue
    error -> Logger.error("could not prepare the restart: #{Exception.message(error)}")
  catch
    kind, reason -> Logger.error("could not prepare the restart: #{inspect({kind, reason})}")
  end

  @doc """
  Returns whether an update is written or was written. The board must not restart for another
  reason then.
  """
  @spec busy?(GenServer.server()) :: boolean()
  def busy?(gate \\ __MODULE__), do: LockServer.lock(names(gate)) != :free

  @impl GenServer
  def init(opts) do
    settings = opts |> Map.new() |> complete()
    robots = [opts[:robot]]
    _ = if LockServer.adopt(%{settings | robots: robots}) == :free, do: LockServer.allow(robots)
    {:ok, settings}
  end

  @impl GenServer
  def handle_call(:settings, _from, settings), do: {:reply, settings, settings}

  # The settings of the gate's process or of the configuration, for all robots of the VM.
  defp settings(gate, opts) do
    settings =
      try do
        GenServer.call(gate, :settings, @call_timeout_ms)
      catch
        :exit, _reason -> without_gate(gate, opts)
      end

    %{settings | robots: Enum.uniq(settings.robots ++ Robots.known())}
  end

  defp without_gate(gate, opts) do
    Logger.warning("the gate for updates does not run; the configured options hold")

    opts
    |> valid_options()
    |> BB.Options.validate!(@configured)
    |> Map.new()
    |> Map.merge(%{name: gate, gate: :not_running})
    |> complete()
  end

  # A wrong option may be the reason why the gate does not run. Its default holds then.
  defp valid_options(opts) when is_list(opts) do
    for {name, _value} = option <- opts,
        Keyword.has_key?(@configured.schema, name),
        match?({:ok, _}, BB.Options.validate([option], @configured)),
        do: option
  end

  defp valid_options(_opts), do: []

  defp complete(opts) do
    %{
      gate: Map.get(opts, :gate, :running),
      robots: List.wrap(opts[:robot]),
      board: opts[:board] || Board.configured(),
      folder: opts[:folder] || Guard.folder(),
      key: opts.public_key,
      settle_ms: opts.settle_ms,
      names: names(opts.name)
    }
  end

  # Takes the lock and forbids arming before it checks whether a robot is armed.
  defp enter(settings) do
    with :ok <- LockServer.enter(settings) do
      LockServer.inhibit(settings.robots)
      finish_precheck(Precheck.decide(facts(settings)), settings)
    else
      {:error, refusal} -> Precheck.decide(%{lock: {:error, refusal}})
    end
  end

  defp facts(settings) do
    %{
      lock: :ok,
      gate: settings.gate,
      key: key(settings.key),
      validation: Trial.status(settings.folder, settings.board),
      safety: Robots.state(settings.robots),
      armed: Robots.armed(settings.robots)
    }
  end

  defp finish_precheck(:ok, settings) do
    _ = record_trial(settings)
    {:ok, [fwup_extra_options: ["--public-key-file", settings.key]]}
  end

  defp finish_precheck(refused, settings) do
    LockServer.leave(settings)
    refused
  end

  defp record_trial(settings) do
    _ =
      if settings.gate == :not_running,
        do:
          Story.add(
            settings.folder,
            "an update was accepted without the gate, which does not run"
          )

    with {:error, reason} <- Trial.accepted(settings.folder, settings.board),
         do: Logger.error("could not record the trial of the update: #{inspect(reason)}")
  end

  defp names(name) when is_atom(name) and name != nil,
    do: {Module.concat(name, "Lock"), Module.concat(name, "Uploader")}

  defp names(_name), do: names(__MODULE__)

  defp key(file) do
    case File.stat(file) do
      {:ok, %{type: :regular, size: size}} when size > 0 -> {:ok, file}
      {:ok, _other} -> {:error, {file, "is empty or no file"}}
      {:error, :enoent} -> {:error, {file, "is missing"}}
      {:error, posix} -> {:error, {file, "cannot be read (#{:file.format_error(posix)})"}}
    end
  end

  defp configured, do: Application.get_env(:ganglion, __MODULE__, [])
end

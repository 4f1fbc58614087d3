defmodule BB.Firmware.Gate do
  @own [
    board: [
      type: {:tuple, [:module, :any]},
      doc: "`BB.Firmware.Board`; the configured one."
    ],
    public_key: [
      type: :string,
      default: "/etc/ganglion/firmware.pub",
      doc: "The file with the key that updates are signed for."
    ],
    folder: [
      type: :string,
      doc: "Where it is noted that an update is on its way; the one of `BB.Firmware.Guard`."
    ],
    settle_ms: [
      type: :non_neg_integer,
      default: 3_000,
      doc:
        "How long after an upload the next one waits, in milliseconds: within this time the " <>
          "board is told whether anything was written."
    ]
  ]

  @schema BB.Options.new!(
            [
              robot: [type: :module, required: true, doc: "The robot that must not be armed."],
              name: [type: :any, default: __MODULE__, doc: "The name of the process."]
            ] ++ @own
          )

  # What is configured for a gate that is gone.
  @own_schema BB.Options.new!(@own)

  @moduledoc """
  Lets an update in, or tells the uploader why not.

  An update is refused while

    * a robot is armed or being disarmed,
    * the running firmware is not validated: it would have nothing to fall back to,
    * another update is written, or one was and the board is about to restart: the two would write to the same place,
    * the public key is missing: without a key `fwup` takes any image, signed or not.

  While an update is written no robot can be armed (`BB.Safety.inhibit/3` at `[:firmware,
  :update]`). After it was written, the robots are disarmed and the board restarted.

      config :ssh_subsystem_fwup,
        precheck_callback: {BB.Firmware.Gate, :precheck, []},
        success_callback: {BB.Firmware.Gate, :written, []}

  ## Without the gate

  `precheck/2` decides in the process that uploads. The gate's process knows the robot and the
  options, no more: on a board whose application does not run, an update is what repairs it, so it
  is let in by the same rules, with the options of the configuration (`config :ganglion,
  BB.Firmware.Gate`). What no application holds is held elsewhere: who uploads, by a process of
  its own (`BB.Firmware.Gate.LockServer`); what is armed, by the tables of `BB.Safety`, without which
  nothing is.

  ## Options

  #{BB.Options.docs(@schema)}
  """

  use GenServer
  use BB.Process.Tolerant

  require Logger

  alias BB.Firmware.{Board, Guard, Robots, Story, Trial}
  alias BB.Firmware.Gate.{LockServer, Precheck}

  @call_timeout_ms 5_000

  @doc "Starts the gate. Raises `BB.Options.ValidationError` for wrong options."
  @spec start_link(keyword()) :: GenServer.on_start()
  def start_link(opts) do
    opts = BB.Options.validate!(opts, @schema)
    GenServer.start_link(__MODULE__, opts, name: opts[:name])
  end

  @doc """
  Whether the calling process may write an update: `{:ok, options}` for `SSHSubsystemFwup`, or `{:error, text}`, which it shows to who
  uploads. From then on the caller holds the gate, until it ends.

  `opts` are the options for the case that there is no gate, the configured ones when not given.
  """
  @spec precheck(GenServer.server(), keyword()) :: {:ok, keyword()} | {:error, String.t()}
  def precheck(gate \\ __MODULE__, opts \\ configured()) do
    with {:error, text} <- gate |> settings(opts) |> enter() do
      Logger.warning("an update was refused: #{text}")
      # The uploader's terminal shows it as it is.
      {:error, text <> "\n"}
    end
  rescue
    error -> refuse(Exception.message(error))
  catch
    kind, reason -> refuse(inspect({kind, reason}, limit: 20))
  end

  defp refuse(why) do
    Logger.error("an update was refused: whether it may be written could not be told: #{why}")
    {:error, "whether an update may be written could not be told: #{why}\n"}
  end

  @doc """
  Called when an update was written: disarms the robots and restarts the board, also when the gate
  itself is gone.
  """
  @spec written(GenServer.server(), keyword()) :: :ok | {:error, term()}
  def written(gate \\ __MODULE__, opts \\ configured()) do
    settings = settings(gate, opts)
    leave_no_way_back(settings)
    Board.reboot(settings.board)
  end

  # Whatever of it fails, the board restarts.
  defp leave_no_way_back(settings) do
    LockServer.written(settings)
    Robots.disarm(settings.robots)
    _ = Trial.written(settings.folder)
    _ = Story.tell(settings.folder, "an update was written; the board restarts with it")
    :ok
  rescue
    error -> Logger.error("before the restart: #{Exception.message(error)}")
  catch
    kind, reason -> Logger.error("before the restart: #{inspect({kind, reason})}")
  end

  @doc """
  Whether somebody writes an update, or has written one: then the board is not to be restarted for
  anything else.
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

  # What is so, asked or configured. A robot that is not the gate's must not be armed either.
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
    Logger.warning("the gate for updates is not there; it is decided without it")

    opts
    |> valid()
    |> BB.Options.validate!(@own_schema)
    |> Map.new()
    |> Map.merge(%{name: gate, gate: :gone})
    |> complete()
  end

  # A wrong option may be why there is no gate. Its default counts then.
  defp valid(opts) when is_list(opts) do
    for {name, _value} = option <- opts,
        Keyword.has_key?(@own, name),
        match?({:ok, _}, BB.Options.validate([option], @own_schema)),
        do: option
  end

  defp valid(_opts), do: []

  defp complete(opts) do
    %{
      gate: Map.get(opts, :gate, :there),
      robots: List.wrap(opts[:robot]),
      board: opts[:board] || Board.configured(),
      folder: opts[:folder] || Guard.folder(),
      key: opts.public_key,
      settle_ms: opts.settle_ms,
      names: names(opts.name)
    }
  end

  # First nobody else can enter and nobody can arm a robot, then it is seen whether one is armed.
  defp enter(settings) do
    with :ok <- LockServer.enter(settings) do
      LockServer.inhibit(settings.robots)
      decided(Precheck.decide(facts(settings)), settings)
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
      safety: Robots.state(settings.robots)
    }
  end

  defp decided(:ok, settings) do
    _ = note(settings)
    {:ok, [fwup_extra_options: ["--public-key-file", settings.key]]}
  end

  defp decided(refused, settings) do
    LockServer.leave(settings)
    refused
  end

  defp note(settings) do
    _ =
      if settings.gate == :gone,
        do:
          Story.tell(settings.folder, "an update was let in without the gate, which is not there")

    with {:error, reason} <- Trial.accepted(settings.folder, settings.board),
         do: Logger.error("the trial of this update was not noted: #{inspect(reason)}")
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

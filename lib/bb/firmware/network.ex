defmodule BB.Firmware.Network do
  @schema BB.Options.new!(
            robot: [type: :module, required: true, doc: "The robot on whose pubsub it is told."],
            name: [type: :any, default: __MODULE__, doc: "The name of the process."],
            source: [
              type: {:tuple, [:module, :any]},
              doc: "`BB.Firmware.Network.Adapter`; the configured one."
            ],
            period_ms: [
              type: :pos_integer,
              default: 1_000,
              doc: "Milliseconds between two messages while nothing changes."
            ],
            disarm_after_ms: [
              type: {:or, [:pos_integer, nil]},
              default: nil,
              doc:
                "How long an armed robot may go without a sign of its operator; `nil` for ever."
            ]
          )

  @moduledoc """
  The network, as a sensor of the robot's: `BB.Message.Network.Connection` on `[:sensor, :network]`, at each change, and each
  period while nothing changes. The last one is kept (`BB.PubSub.last/2`).

  A lost connection by itself changes nothing: a robot goes on with what it does. What a robot cannot do without is a person who
  watches it, where it is declared to need one:

      config :ganglion, BB.Firmware.Network, disarm_after_ms: 2_000

  An armed robot is then disarmed when for so long no message came at `[:operator]` or below. Whatever operates the robot publishes
  there several times a second, by `sign/2`, in the node or over it: a lost connection, a crashed program and a sleeping
  laptop are then the same. See `BB.Firmware.Network.Operator`.

  ## Options

  #{BB.Options.docs(@schema)}
  """

  use GenServer
  use BB.Process.Tolerant

  require Logger

  alias BB.Firmware.Network.{Adapter, Operator}
  alias BB.{Message, PubSub, Safety}
  alias BB.Message.Network.Connection

  @path [:sensor, :network]
  @operator [:operator]
  @looks_in_time 8
  @longest_look_ms 250

  @doc "Starts it. Raises `BB.Options.ValidationError` for wrong options."
  @spec start_link(keyword()) :: GenServer.on_start()
  def start_link(opts) do
    opts = BB.Options.validate!(opts, @schema)
    GenServer.start_link(__MODULE__, opts, name: opts[:name])
  end

  @doc "A sign of life of the robot's operator, who may give a name. Raises `ArgumentError` when the robot is not started."
  @spec sign(module(), String.t() | nil) :: :ok
  def sign(robot, name \\ nil),
    do:
      PubSub.publish(
        robot,
        @operator,
        Message.new!(Message.Network.Operator, :operator, name: name)
      )

  @impl GenServer
  def init(opts) do
    source = opts[:source] || Adapter.configured()

    state = %{
      robot: opts[:robot],
      source: source,
      connection: :unknown,
      heard?: false,
      period_ms: opts[:period_ms],
      look_ms: look_ms(opts),
      operator: Operator.new(opts[:disarm_after_ms]),
      bus: nil,
      published_ms: nil,
      disarming: nil
    }

    {:ok, state, {:continue, :look}}
  end

  @impl GenServer
  def handle_continue(:look, state), do: {:noreply, look(state)}

  @impl GenServer
  def handle_info(:look, state), do: {:noreply, look(state)}

  def handle_info({:bb, [:operator | _], _message}, state),
    do: {:noreply, operate(state, :sign)}

  def handle_info({:bb_missed, _path, _count}, state), do: {:noreply, operate(state, :sign)}

  def handle_info({:DOWN, ref, :process, _pid, _reason}, %{disarming: ref} = state),
    do: {:noreply, %{state | disarming: nil}}

  def handle_info(message, state) do
    case Adapter.change(state.source, message) do
      {:ok, connection} -> {:noreply, publish(%{state | connection: connection})}
      :error -> {:noreply, state}
    end
  end

  # Within what the operator may be late there are some looks.
  defp look_ms(opts) do
    wanted = Enum.min([opts[:period_ms], @longest_look_ms | late(opts[:disarm_after_ms])])
    max(1, wanted)
  end

  defp late(nil), do: []
  defp late(after_ms), do: [div(after_ms, @looks_in_time)]

  defp look(state) do
    _ = Process.send_after(self(), :look, state.look_ms)
    state |> listen() |> attach() |> operate(:tick) |> publish_if_due()
  end

  # What tells of the network may start later than this, or have ended: the robot runs meanwhile.
  defp listen(%{heard?: true} = state), do: state

  defp listen(state) do
    %{state | connection: Adapter.subscribe(state.source), heard?: true}
  rescue
    _error -> state
  catch
    _kind, _reason -> state
  end

  # Subscriptions end with the robot's root.
  defp attach(state) do
    case Process.whereis(state.robot) do
      nil -> %{state | bus: nil}
      bus when bus == state.bus -> state
      bus -> subscribe(%{state | bus: bus, published_ms: nil})
    end
  end

  defp subscribe(state) do
    :ok = PubSub.retain(state.robot, @path)
    {:ok, _} = PubSub.subscribe(state.robot, @operator, max_queue: 100)
    state
  rescue
    # The root is there, its bus is not yet.
    ArgumentError -> %{state | bus: nil}
  end

  defp operate(state, event) do
    {operator, what} =
      Operator.handle(state.operator, event, Safety.armed?(state.robot), now_ms())

    act(what, %{state | operator: operator})
  end

  # Handlers may take their time; signs and connections are heard meanwhile.
  defp act(:disarm, %{disarming: nil} = state) do
    Logger.warning(
      "#{inspect(state.robot)} is disarmed: no sign of its operator for #{state.operator.after_ms} ms"
    )

    robot = state.robot
    {_pid, ref} = spawn_monitor(fn -> Safety.disarm(robot) end)
    %{state | disarming: ref}
  end

  defp act(_nothing, state), do: state

  defp publish_if_due(%{bus: nil} = state), do: state
  defp publish_if_due(%{published_ms: nil} = state), do: publish(state)

  defp publish_if_due(state) do
    if now_ms() - state.published_ms >= state.period_ms, do: publish(state), else: state
  end

  defp publish(state) do
    message = Message.new!(Connection, :network, state: state.connection)
    :ok = PubSub.publish(state.robot, @path, message)
    %{state | published_ms: now_ms()}
  rescue
    # The robot is not started; it is told when it is.
    ArgumentError -> %{state | published_ms: nil}
  end

  defp now_ms, do: System.monotonic_time(:millisecond)
end

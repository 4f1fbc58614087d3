defmodule BB.Firmware.Network do
  @schema BB.Options.new!(
            robot: [type: :module, required: true, doc: "The robot that it publishes for."],
            name: [type: :any, default: __MODULE__, doc: "The name of the process."],
            adapter: [
              type: {:tuple, [:module, :any]},
              doc: "The network (`BB.Firmware.Network.Adapter`); default: the configured one."
            ],
            source: [type: {:tuple, [:module, :any]}, doc: "Deprecated; use `adapter:`."],
            period_ms: [
              type: :pos_integer,
              default: 1_000,
              doc: "The time in milliseconds between two messages while nothing changes."
            ],
            disarm_after_ms: [
              type: {:or, [:pos_integer, nil]},
              default: nil,
              doc:
                "The time in milliseconds after which an armed robot without a sign of its " <>
                  "operator is disarmed; `nil` for never."
            ]
          )

  @moduledoc """
  Publishes the state of the network as a sensor of the robot, and disarms a robot whose
  operator is silent. Use it on boards; `BB.Firmware.Supervisor` starts it with the configured
  options.

      config :ganglion, BB.Firmware.Network, disarm_after_ms: 2_000

  It publishes `BB.Message.Network.Connection` on `[:sensor, :network]` at each change, and every
  period while nothing changes. The last message is retained (`BB.PubSub.last/2`).

  A lost connection by itself does not affect the robot. With `disarm_after_ms:` an armed robot is
  disarmed when no message has come at `[:operator]` or below for that time. The program that
  operates the robot calls `sign/2` several times a second, in this node or from another. So a
  lost connection, a crashed program and a sleeping laptop have the same effect. See
  `BB.Firmware.Network.Operator`.

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
  @checks_in_time 8
  @longest_check_ms 250

  @doc "Starts the process. Raises `BB.Options.ValidationError` for wrong options."
  @spec start_link(keyword()) :: GenServer.on_start()
  def start_link(opts) do
    opts = BB.Options.validate!(opts, @schema)
    GenServer.start_link(__MODULE__, opts, name: opts[:name])
  end

  @doc """
  Publishes a sign of life of the robot's operator, with an optional name. Raises
  `ArgumentError` when the robot is not started.
  """
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
    adapter = opts[:adapter] || opts[:source] || Adapter.configured()

    state = %{
      robot: opts[:robot],
      adapter: adapter,
      connection: :unknown,
      subscribed?: false,
      period_ms: opts[:period_ms],
      check_ms: check_ms(opts),
      operator: Operator.new(opts[:disarm_after_ms]),
      bus: nil,
      published_ms: nil,
      disarming: nil
    }

    {:ok, state, {:continue, :check}}
  end

  @impl GenServer
  def handle_continue(:check, state), do: {:noreply, check(state)}

  @impl GenServer
  def handle_info(:check, state), do: {:noreply, check(state)}

  def handle_info({:bb, [:operator | _], _message}, state),
    do: {:noreply, handle_event(state, :sign)}

  def handle_info({:bb_missed, _path, _count}, state), do: {:noreply, handle_event(state, :sign)}

  def handle_info({:DOWN, ref, :process, _pid, _reason}, %{disarming: ref} = state),
    do: {:noreply, %{state | disarming: nil}}

  def handle_info(message, state) do
    case Adapter.change(state.adapter, message) do
      {:ok, connection} -> {:noreply, publish(%{state | connection: connection})}
      :error -> {:noreply, state}
    end
  end

  # Several checks within the time that the operator has.
  defp check_ms(opts) do
    wanted =
      Enum.min([opts[:period_ms], @longest_check_ms | operator_period(opts[:disarm_after_ms])])

    max(1, wanted)
  end

  defp operator_period(nil), do: []
  defp operator_period(after_ms), do: [div(after_ms, @checks_in_time)]

  defp check(state) do
    _ = Process.send_after(self(), :check, state.check_ms)
    state |> subscribe_network() |> subscribe_pubsub() |> handle_event(:tick) |> publish_if_due()
  end

  # The network may start later than this process, or have ended.
  defp subscribe_network(%{subscribed?: true} = state), do: state

  defp subscribe_network(state) do
    %{state | connection: Adapter.subscribe(state.adapter), subscribed?: true}
  rescue
    _error -> state
  catch
    _kind, _reason -> state
  end

  # Subscriptions end with the robot's root.
  defp subscribe_pubsub(state) do
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
    # The root supervisor runs, and its pubsub does not run yet.
    ArgumentError -> %{state | bus: nil}
  end

  defp handle_event(state, event) do
    {operator, effect} =
      Operator.handle(state.operator, event, Safety.armed?(state.robot), now_ms())

    execute(effect, %{state | operator: operator})
  end

  # Disarms in a process of its own, so that messages are handled meanwhile.
  defp execute(:disarm, %{disarming: nil} = state) do
    Logger.warning(
      "#{inspect(state.robot)} is disarmed: no sign of its operator " <>
        "for #{state.operator.after_ms} ms"
    )

    robot = state.robot
    {_pid, ref} = spawn_monitor(fn -> Safety.Controller.disarm(robot) end)
    %{state | disarming: ref}
  end

  defp execute(_nothing, state), do: state

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
    # The robot is not started. It is published again when the robot is.
    ArgumentError -> %{state | published_ms: nil}
  end

  defp now_ms, do: System.monotonic_time(:millisecond)
end

defmodule BB.Actuator.CommandCheck do
  @moduledoc """
  Checks each command that reaches an actuator, in the actuator's process.

  `BB.Actuator` uses it. A command reaches the actuator's driver if

    1. its payload is one that the driver declares (`c:BB.Actuator.command_payloads/1`),
    2. the robot is armed,
    3. the message has the epoch of the present arming (`BB.Safety.epoch/1`).

  Nothing is exempt, neither a `Stop` nor a `Hold`. A refusal is logged, emitted as the telemetry
  event `[:bb, :actuator, :rejected]` with the measurement `count: 1` and the metadata `:robot`,
  `:actuator`, `:transport` (`:call`, `:cast` or `:pubsub`), `:payload_module` and `:reason`
  (`:unsupported_command`, `:disarmed` or `:stale_epoch`), and sent to the sender that waits for
  it.
  """
  @moduledoc no_example: "internal: BB.Actuator describes the refusals"

  require Logger

  alias BB.Error.State.{NotArmed, StaleEpoch, UnsupportedCommand}
  alias BB.{Message, PubSub, Safety, Telemetry, Transmission}
  alias BB.Message.Actuator.Command

  @default_payloads [
    Command.Effort,
    Command.Hold,
    Command.Position,
    Command.Stop,
    Command.Trajectory,
    Command.Velocity
  ]

  @enforce_keys [:robot, :path, :payloads]
  defstruct [:robot, :path, :payloads]

  @type t :: %__MODULE__{robot: module(), path: [atom(), ...], payloads: [module()]}

  @typedoc "The result for a request, see `c:BB.Component.component_request/4`."
  @type decision :: :pass | {:command, Message.t()} | {:answer, term()}

  @doc "Returns the payloads that a driver takes unless it declares others."
  @spec default_payloads() :: [module()]
  def default_payloads, do: @default_payloads

  @doc "Subscribes the actuator's process to the commands that the driver declares."
  @spec start(module(), keyword()) :: t()
  def start(module, options) do
    %{robot: robot, path: path} = options[:bb]
    payloads = payloads(module, options)

    if payloads != [], do: subscribe(robot, path, payloads)
    %__MODULE__{robot: robot, path: path, payloads: payloads}
  end

  # A subscription without types would be one to all messages.
  defp subscribe(robot, path, payloads) do
    {:ok, _pubsub} = PubSub.subscribe(robot, [:actuator | path], message_types: payloads)
    :ok
  end

  defp payloads(module, options) do
    cond do
      not function_exported?(module, :handle_command, 2) -> []
      not function_exported?(module, :command_payloads, 1) -> default_payloads()
      true -> check_payloads(module.command_payloads(options), module)
    end
  end

  defp check_payloads(payloads, module) do
    if is_list(payloads) and Enum.all?(payloads, &is_atom/1) do
      payloads
    else
      raise ArgumentError,
            "expected #{inspect(module)}.command_payloads/1 to return a list of payload " <>
              "modules, got: #{inspect(payloads)}"
    end
  end

  @doc "Decides about a request to the actuator's process."
  @spec decide(BB.Component.transport(), request :: term(), t(), keyword()) :: decision()
  def decide(:call, {:command, %Message{} = message}, check, options),
    do: check(message, :call, nil, check, options)

  def decide(:call, {:command, _no_message}, _check, _options),
    do: {:answer, {:error, :not_a_command}}

  def decide(:cast, {:command, %Message{} = message}, check, options),
    do: check(message, :cast, nil, check, options)

  def decide(:cast, {:command, %Message{} = message, reply_to}, check, options)
      when is_pid(reply_to) or is_nil(reply_to),
      do: check(message, :cast, reply_to, check, options)

  def decide(
        :message,
        {:bb, [:actuator | path], %Message{payload: %type{}} = message},
        %{path: path} = check,
        options
      ) do
    if type in check.payloads,
      do: check(message, :pubsub, nil, check, options),
      else: :pass
  end

  def decide(_transport, _request, _check, _options), do: :pass

  defp check(message, transport, reply_to, check, options) do
    with :ok <- check_payload(message, check),
         {:ok, epoch} <- check_armed(message, check),
         :ok <- check_epoch(message, epoch, check) do
      {:command, Transmission.apply_to_command(message, transmission(options))}
    else
      {:error, reason, error} -> refuse(message, transport, reply_to, check, reason, error)
    end
  end

  defp transmission(options), do: options[:actuator_profile].transmission

  defp check_payload(message, %{payloads: payloads} = check) do
    if payload_module(message) in payloads,
      do: :ok,
      else: error(:unsupported_command, UnsupportedCommand, message, check, supported: payloads)
  end

  # The robot may be disarmed between the two reads.
  defp check_armed(message, %{robot: robot} = check) do
    with true <- Safety.armed?(robot), {:ok, epoch} <- Safety.epoch(robot) do
      {:ok, epoch}
    else
      _ -> error(:disarmed, NotArmed, message, check, [])
    end
  end

  defp check_epoch(%{arm_epoch: epoch}, epoch, _check), do: :ok

  defp check_epoch(message, current, check) do
    fields = [epoch: message.arm_epoch, current_epoch: current]
    error(:stale_epoch, StaleEpoch, message, check, fields)
  end

  defp error(reason, type, message, check, fields) do
    common = [robot: check.robot, actuator: name(check), command: payload_module(message)]
    {:error, reason, struct!(type, common ++ fields)}
  end

  defp refuse(message, transport, reply_to, check, reason, error) do
    Logger.warning("#{inspect(check.robot)}: #{Exception.message(error)}")

    Telemetry.emit(
      [:bb, :actuator, :rejected],
      %{count: 1},
      %{
        robot: check.robot,
        actuator: name(check),
        transport: transport,
        payload_module: payload_module(message),
        reason: reason
      },
      apart: true
    )

    if reply_to,
      do: send(reply_to, {:bb, :command_rejected, name(check), command_id(message), error})

    {:answer, {:error, error}}
  end

  defp command_id(%{payload: payload}), do: Map.get(payload, :command_id)
  defp payload_module(%{payload: %module{}}), do: module
  defp payload_module(_message), do: nil
  defp name(check), do: List.last(check.path)
end

defmodule BB.Actuator.Delivery do
  @moduledoc """
  Makes the commands that the functions of `BB.Actuator` send, and delivers them.
  """
  @moduledoc no_example: "internal: the functions of BB.Actuator are its interface"

  alias BB.{Message, Options, PubSub, Robot, Safety}
  alias BB.Options.ValidationError

  @duration [duration: [type: {:or, [:pos_integer, nil]}, default: nil]]

  @own %{
    Message.Actuator.Command.Position =>
      [velocity: [type: {:or, [:float, nil]}, default: nil]] ++ @duration,
    Message.Actuator.Command.Velocity => @duration,
    Message.Actuator.Command.Effort => @duration,
    Message.Actuator.Command.Trajectory => [
      repeat: [type: {:or, [:pos_integer, {:literal, :forever}]}, default: 1]
    ],
    Message.Actuator.Command.Stop => [
      mode: [type: {:in, [:immediate, :decelerate]}, default: :immediate]
    ],
    Message.Actuator.Command.Hold => []
  }

  @delivery [:delivery, :timeout, :reply_on_reject?]

  @typedoc "The name of an actuator, or its path."
  @type target :: atom() | [atom(), ...]

  @doc """
  Sends a command with the given fields, and the fields among the options.

  `default` is the delivery unless the options name one.
  """
  @spec send_command(module(), target(), module(), keyword(), keyword(), atom()) ::
          :ok | {:error, term()}
  def send_command(robot, target, payload, fields, opts, default) do
    {delivery, own} = split(opts, payload, default)
    message = message(robot, target, payload, fields ++ own)

    case delivery[:delivery] do
      :direct -> cast(robot, target, message, delivery[:reply_on_reject?])
      :broadcast -> publish(robot, target, message, [])
      :pubsub -> publish_and_call(robot, target, message, delivery[:timeout])
    end
  end

  @doc "Calls the actuator with a command that is not published, and returns its answer."
  @spec call(module(), target(), module(), keyword(), keyword(), timeout()) :: term()
  def call(robot, target, payload, fields, opts, timeout) do
    {_delivery, own} = split(opts, payload, :direct)
    path = path!(robot, target)
    request(robot, List.last(path), message(robot, path, payload, fields ++ own), timeout)
  end

  defp split(opts, payload, default) do
    opts = Options.validate!(opts, Map.fetch!(@own, payload) ++ common(default))
    {delivery, own} = Keyword.split(opts, @delivery)
    check_reply!(delivery[:reply_on_reject?], delivery[:delivery])
    {delivery, own}
  end

  defp common(default) do
    [
      delivery: [type: {:in, [:pubsub, :broadcast, :direct]}, default: default],
      command_id: [type: {:or, [:reference, nil]}, default: nil],
      timeout: [type: :timeout, default: 5_000],
      reply_on_reject?: [type: :boolean, default: false]
    ]
  end

  defp check_reply!(false, _delivery), do: :ok
  defp check_reply!(true, :direct), do: :ok

  defp check_reply!(true, delivery) do
    message =
      "invalid value for :reply_on_reject? option: expected false with delivery: " <>
        "#{inspect(delivery)}, #{because(delivery)}, got: true; " <>
        "use delivery: :direct, or leave reply_on_reject? out"

    raise ValidationError, key: :reply_on_reject?, value: true, message: message
  end

  defp because(:pubsub), do: "which returns the refusal"
  defp because(:broadcast), do: "which sends the command to every subscriber"

  # The epoch of now allows the command, not that of the moment when it arrives.
  defp message(robot, target, payload, fields) do
    message = Message.new!(payload, name(target), fields)

    case Safety.epoch(robot) do
      {:ok, epoch} -> %{message | arm_epoch: epoch}
      _not_armed -> message
    end
  end

  defp cast(robot, target, message, reply?) do
    request = if reply?, do: {:command, message, self()}, else: {:command, message}
    BB.Process.cast(robot, name(target), request)
  end

  defp publish_and_call(robot, target, message, timeout) do
    path = path!(robot, target)
    name = List.last(path)
    :ok = publish(robot, path, message, except: [BB.Process.whereis(robot, name)])

    case request(robot, name, message, timeout) do
      {:error, reason} -> {:error, reason}
      _accepted -> :ok
    end
  end

  defp request(robot, name, message, timeout),
    do: BB.Process.call(robot, name, {:command, message}, timeout)

  defp publish(robot, target, message, opts),
    do: PubSub.publish(robot, [:actuator | path!(robot, target)], message, opts)

  defp name(name) when is_atom(name), do: name
  defp name(path), do: List.last(path)

  defp path!(_robot, [_ | _] = path), do: path

  defp path!(robot, name) when is_atom(name) do
    case Robot.actuator_path(robot.robot(), name) do
      {:ok, path} -> path
      {:error, _unknown} -> raise ArgumentError, unknown(robot, name)
    end
  end

  defp unknown(robot, name) do
    "robot #{inspect(robot)} has no actuator named #{inspect(name)}; its actuators are: " <>
      inspect(robot.robot().actuators |> Map.keys() |> Enum.sort())
  end
end

defmodule BB.Sensor.Mimic do
  @options BB.Options.new!(
             source: [
               type: {:or, [:atom, {:list, :atom}]},
               required: true,
               doc: """
               The other sensor: its name, or its path, such as \
               `[:base_link, :shoulder, :encoder]`.
               """
             ],
             multiplier: [
               type: :float,
               default: 1.0,
               doc: "The motion of this joint for a motion of the other by one."
             ],
             offset: [
               type: :float,
               default: 0.0,
               doc: "The position of this joint when the other is at zero, in rad or m."
             ],
             message_types: [
               type: {:list, :atom},
               default: [BB.Message.Sensor.JointState],
               doc: "The payloads of the other sensor that are published."
             ]
           )

  @moduledoc """
  A sensor that derives the state of a joint from the sensor of another joint.

  Declare it for a joint that moves with another, such as the second finger of a gripper or the
  far end of a belt:

      joint :right_finger do
        sensor :right, {BB.Sensor.Mimic, source: :left, multiplier: -1.0}
      end

  For each `BB.Message.Sensor.JointState` of the source it publishes one of its own joint, with
  the same time: positions are multiplied and offset, velocities are multiplied. Efforts are left
  out, since the load on one joint of a pair does not determine the load on the other. When the
  source publishes several joints at once, the source's own joint counts, or the first. A payload
  of another type is published unchanged, with this sensor's frame_id.

  The sensor has no clock of its own, and is silent when its source is silent.

  ## Options

  #{BB.Options.docs(@options)}
  """

  use BB.Sensor, options_schema: @options.schema

  alias BB.{Message, PubSub, Sensor}
  alias BB.Message.Sensor.JointState

  @impl BB.Sensor
  def init(opts) do
    bb = opts[:bb]

    with {:ok, path} <- source_path(bb.robot, opts[:source]) do
      {:ok, _} = PubSub.subscribe(bb.robot, [:sensor | path], message_types: opts[:message_types])
      {:ok, %{bb: bb, source: [:sensor | path], name: name(opts), coupling: coupling(opts)}}
    else
      :error -> {:stop, {:no_sensor, opts[:source]}}
    end
  end

  @impl BB.Sensor
  def handle_options(opts, state) do
    PubSub.unsubscribe(state.bb.robot, state.source)

    init(opts)
  end

  @impl BB.Sensor
  def handle_info({:bb, source, %Message{} = message}, %{source: source} = state) do
    Sensor.publish(state.bb, imitate(message, state.name, state.coupling))
    {:noreply, state}
  end

  def handle_info(_message, state), do: {:noreply, state}

  @impl BB.Sensor
  def explain({:no_sensor, source}),
    do: "the robot has no sensor #{inspect(source)}: correct `source:`"

  @doc false
  def imitate(%Message{payload: %JointState{} = state} = message, name, {multiplier, offset}) do
    index = Enum.find_index(state.names, &(&1 == message.frame_id)) || 0

    payload = %JointState{
      names: [name],
      positions: convert(state.positions, index, &(multiplier * &1 + offset)),
      velocities: convert(state.velocities, index, &(multiplier * &1))
    }

    %{message | frame_id: name, payload: payload}
  end

  def imitate(message, name, _coupling), do: %{message | frame_id: name}

  # A value that the source lacks, or that is no plain number, is left out.
  defp convert(values, index, change) do
    case Enum.at(values, index) do
      value when is_number(value) -> [change.(value)]
      _ -> []
    end
  end

  defp source_path(_robot, [_ | _] = path), do: {:ok, path}

  defp source_path(robot, name) do
    case BB.Robot.fetch_component(robot.robot(), name) do
      {:ok, %{kind: BB.Sensor, path: path}} -> {:ok, path}
      _ -> :error
    end
  end

  defp name(opts), do: opts[:sensor_profile].joint_name || List.last(opts[:bb].path)
  defp coupling(opts), do: {opts[:multiplier], opts[:offset]}
end

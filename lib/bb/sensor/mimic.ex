defmodule BB.Sensor.Mimic do
  @options BB.Options.new!(
             source: [
               type: {:or, [:atom, {:list, :atom}]},
               required: true,
               doc: """
               The other joint, a sibling of this one. Or a sensor elsewhere: its name, or its \
               path, such as `[:base_link, :shoulder, :encoder]`.
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
               doc: "The payloads of the other joint's sensors that are published."
             ]
           )

  @moduledoc """
  A sensor that derives the state of its joint from the sensors of another joint.

  Declare it on a joint that moves with another, such as the second finger of a gripper or the far
  end of a belt:

      joint :left_finger do
        sensor :encoder, {BB.Sensor.As5600, bus: "i2c-1"}
      end

      joint :right_finger do
        sensor :right, {BB.Sensor.Mimic, source: :left_finger, multiplier: -1.0}
      end

  It follows the sensors of the joint `source`, whatever their names. For each
  `BB.Message.Sensor.JointState` it publishes one of its own joint on its own path: positions are
  multiplied and offset, velocities are multiplied, and every name is its joint's name. The
  frame_id, the times and the efforts do not change. A payload of another type that
  `message_types` names is published unchanged, also from below the joint's child link.

  A `source` that is no joint may be a sensor of the robot, by its name or its path. When that
  sensor publishes several joints at once, the joint that is its frame_id counts, or the first.

  The sensor has no clock of its own, and is silent when its source is silent.

  ## Options

  #{BB.Options.docs(@options)}
  """

  use BB.Sensor, options_schema: @options.schema

  alias BB.{Message, PubSub, Robot}
  alias BB.Message.Sensor.JointState

  @impl BB.Sensor
  def init(opts) do
    %{robot: robot, path: path} = bb = opts[:bb]
    source = Keyword.fetch!(opts, :source)
    message_types = Keyword.get(opts, :message_types, [JointState])

    with {:ok, follows, source_path} <- source(robot, path, source) do
      _ = PubSub.subscribe(robot, source_path, message_types: message_types)

      {:ok,
       %{
         bb: bb,
         source: source,
         follows: follows,
         source_path: source_path,
         multiplier: Keyword.get(opts, :multiplier, 1.0),
         offset: Keyword.get(opts, :offset, 0.0),
         message_types: message_types,
         joint_name: Enum.at(path, -2),
         sensor_name: List.last(path)
       }}
    else
      :error -> {:stop, {:no_source, source}}
    end
  end

  @impl BB.Sensor
  def handle_options(opts, state) do
    PubSub.unsubscribe(state.bb.robot, state.source_path)

    init(opts)
  end

  @impl BB.Sensor
  def handle_info({:bb, path, %Message{} = message}, state) do
    if path != own_path(state) and counts?(message, path, state),
      do: BB.publish(state.bb.robot, own_path(state), imitate(message, state))

    {:noreply, state}
  end

  def handle_info(_message, state), do: {:noreply, state}

  @impl BB.Sensor
  def explain({:no_source, source}),
    do: "the robot has no joint and no sensor #{inspect(source)}: correct `source:`"

  defp own_path(%{bb: %{path: path}}), do: [:sensor | path]

  # A joint beyond the child link of the source has a motion of its own.
  defp counts?(%Message{payload: %JointState{}}, path, %{source_path: source_path}) do
    not List.starts_with?(path, source_path) or length(path) <= length(source_path) + 1
  end

  defp counts?(_message, _path, _state), do: true

  defp imitate(%Message{payload: %JointState{} = reading} = message, state) do
    reading = if state.follows == :sensor, do: take_one(reading, message.frame_id), else: reading

    payload = %{
      reading
      | names: Enum.map(reading.names, fn _name -> state.joint_name || state.sensor_name end),
        positions: convert(reading.positions, &(&1 * state.multiplier + state.offset)),
        velocities: convert(reading.velocities, &(&1 * state.multiplier))
    }

    %{message | payload: payload}
  end

  defp imitate(message, _state), do: message

  defp take_one(reading, frame_id) do
    index = Enum.find_index(reading.names, &(&1 == frame_id)) || 0
    fields = [:names, :positions, :velocities, :efforts]
    Enum.reduce(fields, reading, &Map.update!(&2, &1, fn list -> Enum.slice(list, index, 1) end))
  end

  # The position of a planar or floating joint is no number.
  defp convert(values, change),
    do: for(value <- values, do: if(is_number(value), do: change.(value), else: value))

  defp source(_robot, _own_path, [_ | _] = path), do: {:ok, :sensor, [:sensor | path]}

  defp source(robot, own_path, name) do
    case declared(robot) do
      nil -> {:ok, :joint, sibling(own_path, name)}
      declared -> declared_source(declared, name)
    end
  end

  # In a test of a driver without a robot the source is a joint.
  defp sibling(own_path, name), do: [:sensor | Enum.drop(own_path, -2)] ++ [name]

  defp declared_source(declared, name) do
    case {Robot.fetch_joint(declared, name), Robot.fetch_component(declared, name)} do
      {{:ok, _joint}, _} -> {:ok, :joint, [:sensor | path!(declared, name)]}
      {:error, {:ok, %{kind: BB.Sensor, path: path}}} -> {:ok, :sensor, [:sensor | path]}
      _none -> :error
    end
  end

  defp path!(declared, joint) do
    {:ok, path} = Robot.path_to(declared, joint)
    path
  end

  defp declared(robot) do
    if Code.ensure_loaded?(robot) and function_exported?(robot, :robot, 0), do: robot.robot()
  end
end

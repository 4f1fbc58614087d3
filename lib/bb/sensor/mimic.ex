defmodule BB.Sensor.Mimic do
  @options BB.Options.new!(
             source: [
               type: {:or, [:atom, {:list, :atom}]},
               required: true,
               doc:
                 "The other sensor: its name, or its path as `[:base_link, :shoulder, :encoder]`."
             ],
             multiplier: [
               type: :float,
               default: 1.0,
               doc: "How far this joint moves when the other moves by one."
             ],
             offset: [
               type: :float,
               default: 0.0,
               doc: "Where this joint is when the other is at zero, in rad or m."
             ],
             message_types: [
               type: {:list, :atom},
               default: [BB.Message.Sensor.JointState],
               doc: "The payloads of the other sensor that are taken over."
             ]
           )

  @moduledoc """
  The state of a joint that moves with another, from the other's sensor: the second finger of a gripper, the far end of a belt.

      joint :right_finger do
        sensor :right, {BB.Sensor.Mimic, source: :left, multiplier: -1.0}
      end

  For each `BB.Message.Sensor.JointState` of the source it publishes one of its own joint, of the same moment: positions are
  multiplied and offset, velocities multiplied. Efforts are left out: what one joint of a pair bears says nothing of the other.
  When the source publishes several joints at once, its own counts, or the first. A payload of another type is published as it
  is, with this sensor's frame_id.

  It has no clock of its own, and is silent when its source is.

  ## Options

  #{BB.Options.docs(@options)}
  """

  use BB.Sensor, options_schema: @options.schema

  alias BB.{Message, PubSub, Sensor}
  alias BB.Message.Sensor.JointState

  @impl BB.Sensor
  def init(opts) do
    bb = opts[:bb]

    with {:ok, path} <- source(bb.robot, opts[:source]) do
      {:ok, _} = PubSub.subscribe(bb.robot, [:sensor | path], message_types: opts[:message_types])
      {:ok, %{bb: bb, source: [:sensor | path], name: name(opts), coupling: coupling(opts)}}
    else
      :error -> {:stop, {:no_sensor, opts[:source]}}
    end
  end

  @impl BB.Sensor
  def handle_options(opts, state) do
    PubSub.unsubscribe(state.bb.robot, state.source)

    case init(opts) do
      {:stop, reason} -> {:stop, reason}
      {:ok, state} -> {:ok, state}
    end
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
      positions: at(state.positions, index, &(multiplier * &1 + offset)),
      velocities: at(state.velocities, index, &(multiplier * &1))
    }

    %{message | frame_id: name, payload: payload}
  end

  def imitate(message, name, _coupling), do: %{message | frame_id: name}

  # What the source does not know, or what is no plain number, is not known here either.
  defp at(values, index, change) do
    case Enum.at(values, index) do
      value when is_number(value) -> [change.(value)]
      _ -> []
    end
  end

  defp source(_robot, [_ | _] = path), do: {:ok, path}

  defp source(robot, name) do
    case BB.Robot.fetch_component(robot.robot(), name) do
      {:ok, %{kind: BB.Sensor, path: path}} -> {:ok, path}
      _ -> :error
    end
  end

  defp name(opts), do: opts[:sensor_profile].joint_name || List.last(opts[:bb].path)
  defp coupling(opts), do: {opts[:multiplier], opts[:offset]}
end

# A controller as a package for any kind of message is written: the payloads are options, and the
# controller reads the schemas of their fields.
defmodule PidController.Law do
  @moduledoc false

  defstruct [:kp, :ki, :kd, integral: 0.0, error: nil]

  def output(law, error, dt) do
    integral = law.integral + error * dt
    slope = if law.error && dt > 0, do: (error - law.error) / dt, else: 0.0
    output = law.kp * error + law.ki * integral + law.kd * slope
    {output, %{law | integral: integral, error: error}}
  end
end

defmodule PidController.Value do
  @moduledoc false

  defstruct [:value]

  use BB.Message, schema: [value: [type: :float, required: true]]
end

defmodule PidController do
  @moduledoc false

  use BB.Controller

  import BB.Unit
  import BB.Unit.Option

  alias BB.{Message, PubSub}
  alias PidController.Law

  @topic [type: {:list, :atom}, required: true]
  @payload [type: {:behaviour, BB.Message}, required: true]
  @field [type: :atom, required: true]

  @impl BB.Controller
  def options_schema do
    Spark.Options.new!(
      kp: [type: :float, default: 0.0],
      ki: [type: :float, default: 0.0],
      kd: [type: :float, default: 0.0],
      set_point_topic: @topic,
      set_point_message: @payload,
      set_point_field: @field,
      measurement_topic: @topic,
      measurement_message: @payload,
      measurement_field: @field,
      output_topic: @topic,
      output_message: @payload,
      output_field: @field,
      rate: [type: unit_type(compatible: :hertz), default: ~u(100 hertz)]
    )
  end

  @impl BB.Controller
  def init(opts) do
    with :ok <- check(opts, :set_point),
         :ok <- check(opts, :measurement),
         :ok <- check(opts, :output) do
      robot = opts[:bb].robot
      subscribe(robot, opts[:set_point_topic], opts[:set_point_message])
      subscribe(robot, opts[:measurement_topic], opts[:measurement_message])
      loop = opts[:bb] |> BB.Loop.new(clock: {:rate, opts[:rate]}) |> BB.Loop.arm()
      state = %{bb: opts[:bb], loop: loop, set_point: nil, measurement: nil}
      {:ok, Map.merge(state, %{opts: Map.new(opts), law: law(opts)})}
    else
      {:error, text} -> {:stop, {:invalid_config, text}}
    end
  end

  @impl BB.Controller
  def handle_options(opts, state),
    do: {:ok, %{state | opts: Map.new(opts), law: Map.merge(state.law, gains(opts))}}

  @impl BB.Controller
  def handle_info({:bb, path, %Message{payload: payload}}, %{opts: opts} = state) do
    state
    |> take(:set_point, path, payload, opts.set_point_topic, opts.set_point_field)
    |> take(:measurement, path, payload, opts.measurement_topic, opts.measurement_field)
    |> then(&{:noreply, &1})
  end

  def handle_info(:tick, state) do
    {dt, _skipped, loop} = BB.Loop.tick(state.loop)
    {:noreply, act(%{state | loop: loop}, dt)}
  end

  defp act(%{set_point: set, measurement: is} = state, dt)
       when is_float(set) and is_float(is) and is_float(dt) do
    {output, law} = Law.output(state.law, set - is, dt)
    [frame] = state.bb.path

    message = Message.new!(state.opts.output_message, frame, [{state.opts.output_field, output}])

    PubSub.publish(state.bb.robot, state.opts.output_topic, message)
    %{state | law: law}
  end

  defp act(state, _dt), do: state

  defp take(state, key, topic, payload, topic, field),
    do: %{state | key => Map.fetch!(payload, field)}

  defp take(state, _key, _path, _payload, _topic, _field), do: state

  defp subscribe(robot, topic, module),
    do: {:ok, _} = PubSub.subscribe(robot, topic, message_types: [module])

  defp check(opts, what) do
    module = opts[:"#{what}_message"]
    field = opts[:"#{what}_field"]

    case module.schema().schema[field][:type] do
      :float -> :ok
      nil -> {:error, "#{inspect(module)} has no field #{inspect(field)}"}
      type -> {:error, "field #{inspect(field)} is #{inspect(type)}, expected :float"}
    end
  end

  defp law(opts), do: struct!(Law, gains(opts))
  defp gains(opts), do: Map.new(Keyword.take(opts, [:kp, :ki, :kd]))
end

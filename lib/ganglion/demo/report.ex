defmodule Ganglion.Demo.Report do
  @moduledoc """
  Formats what the demonstration has observed, as a screen, as a summary and as JSON data.

  `Ganglion.Demo` makes a `t:view/0` once a second and prints the result. It is pure.

      view |> Ganglion.Demo.Report.screen() |> IO.write()
  """

  alias BB.Message.Sensor.{Contact, Imu, JointState, PowerState, Range}
  alias BB.Message.System.Status
  alias BB.Message.Vision.TagDetections
  alias BB.Math.Vec3
  alias Ganglion.Console.{Payload, Table}
  alias Ganglion.Demo.{Counter, Latency, Observation}

  @typedoc """
  The data of a report.

  `carried` has the counters of outlets and inlets, `outputs` the ring topic of each sensor that
  has one. `vision?` tells whether the robot detects tags, and `processor` is the VM's share of a
  core.
  """
  @type view :: %{
          name: String.t(),
          observation: Observation.t(),
          health: [map()],
          carried: %{atom() => map()},
          processor: float() | nil,
          outputs: %{atom() => String.t()},
          vision?: boolean(),
          seconds: number(),
          now: integer(),
          log: [String.t()]
        }

  @doc "Returns the screen: sensors, topics, vision and the latest lines of the log."
  @spec screen(view()) :: iodata()
  def screen(view) do
    [
      "#{view.name}, #{round(view.seconds)} s   (Ctrl-C stops)\n\n",
      row(["sensor", "state", "Hz", "of", "age", "restarts", "last value"]),
      Enum.map(view.health, &sensor_row(&1, view)),
      "\n",
      ring_lines(view),
      processor_line(view),
      if(view.log == [], do: [], else: ["\n", Enum.map(view.log, &[Table.cut(&1), "\n"])])
    ]
  end

  @doc "Returns the summary as data, for `bin/demo --json`."
  @spec summary(view()) :: map()
  def summary(%{observation: observation} = view) do
    %{
      sensors: Map.new(view.health, fn sensor -> {sensor.name, sensor_summary(sensor, view)} end),
      vision: %{
        frames: observation.frames,
        detections: observation.detections,
        p50_us: Latency.quantile_us(observation.latency, 0.5),
        p99_us: Latency.quantile_us(observation.latency, 0.99)
      },
      ring: %{lost: Observation.lost(observation), torn: torn(view)},
      cpu_percent: view.processor && Float.round(view.processor * 100, 1)
    }
  end

  @doc "Returns the summary as text."
  @spec closing(view()) :: iodata()
  def closing(view) do
    summary = summary(view)

    [
      "summary after #{Float.round(view.seconds / 1, 1)} s\n",
      for {name, sensor} <- Enum.sort(summary.sensors) do
        "  #{pad(name, 15)} #{pad(sensor.state, 8)} #{sensor.published} published, " <>
          "#{rates(sensor)}, #{sensor.restarts} restarts\n"
      end,
      if(view.vision?, do: ["  ", vision_line(view)], else: []),
      if(ring?(view),
        do: [
          "  ring: #{summary.ring.lost} lost, #{summary.ring.torn} torn, topics ",
          Enum.map_join(Enum.sort(Map.keys(view.observation.topics)), ", ", & &1),
          "\n"
        ],
        else: []
      ),
      "  ",
      processor_line(view)
    ]
  end

  defp rates(%{declared_hz: nil, hz: hz}), do: "#{hz} Hz"
  defp rates(%{declared_hz: declared_hz, hz: hz}), do: "#{hz} of #{declared_hz} Hz"

  defp ring?(view), do: view.observation.topics != %{}

  defp ring_lines(view) do
    rows = [["topic", "state", "Hz", "count", "lost", "readers"] | topics(view)]
    longest = rows |> Enum.map(&String.length(hd(&1))) |> Enum.max()

    if ring?(view),
      do: [
        Enum.map(rows, &topic_row(&1, max(longest + 1, 15))),
        "\n",
        if(view.vision?, do: vision_line(view), else: [])
      ],
      else: []
  end

  defp processor_line(%{processor: nil}), do: ""

  defp processor_line(%{processor: share}),
    do: "the BEAM uses #{Float.round(share * 100, 1)} % of one core, simulation included\n"

  defp sensor_summary(sensor, view) do
    {published, hz} =
      case counter(sensor, view) do
        nil -> {0, 0.0}
        counter -> {counter.count, Float.round(Counter.mean_rate(counter), 2)}
      end

    %{
      state: sensor.state,
      published: published,
      hz: hz,
      declared_hz: sensor.declared_hz,
      restarts: sensor.restarts,
      error: sensor.error
    }
  end

  # Messages from the ring that could not be decoded. The ring drops half-written and overwritten
  # ones.
  defp torn(view),
    do: view.carried |> Map.values() |> Enum.map(&Map.get(&1, :malformed, 0)) |> Enum.sum()

  defp sensor_row(sensor, view) do
    counter = counter(sensor, view)

    [
      row([
        sensor.name,
        sensor.state,
        counter && Float.round(Counter.rate(counter), 1),
        sensor.declared_hz,
        counter && Table.age(Counter.age(counter, view.now)),
        sensor.restarts,
        last_value(sensor, view)
      ]),
      Table.trouble(sensor)
    ]
  end

  # The messages of a sensor are on its pubsub path or on its ring topic.
  defp counter(sensor, %{observation: observation, outputs: outputs}) do
    case {observation.paths[[:sensor | sensor.path]], observation.topics[outputs[sensor.name]]} do
      {{counter, _payload}, _} -> counter
      {nil, {counter, _info}} -> counter
      {nil, nil} -> nil
    end
  end

  defp last_value(%{state: state}, _view) when state != :up, do: ""

  defp last_value(sensor, view) do
    case view.observation.paths[[:sensor | sensor.path]] do
      {_counter, payload} -> describe(payload)
      nil -> describe(view.carried[sensor.name])
    end
  end

  defp describe(%Imu{angular_velocity: turn, linear_acceleration: acceleration}),
    do: "#{decimal(length_of(turn))} rad/s, #{decimal(length_of(acceleration))} m/s2"

  defp describe(%JointState{positions: [position], velocities: velocities}),
    do:
      Enum.join(
        ["#{decimal(position)} rad" | for(v <- velocities, do: "#{decimal(v)} rad/s")],
        ", "
      )

  defp describe(%PowerState{voltage: voltage, current: current}),
    do: "#{decimal(voltage)} V, #{decimal(current)} A"

  defp describe(%Status{load_1_min: load, memory_available: bytes}),
    do: "load #{decimal(load)}, #{div(bytes, 1_000_000)} MB free"

  defp describe(%Range{range: :infinity}), do: "nothing in range"
  defp describe(%Range{range: range}), do: "#{decimal(range)} m"
  defp describe(%Contact{pressed: pressed?}), do: if(pressed?, do: "pressed", else: "not pressed")

  defp describe(%TagDetections{detections: []}), do: "no tag in sight"

  defp describe(%TagDetections{detections: detections}) do
    ids = detections |> Enum.map(& &1.id) |> Enum.sort() |> Enum.map_join(" ", &to_string/1)
    "#{length(detections)} tags: #{Table.cut(ids, 18)}"
  end

  defp describe(%{lost: lost, malformed: malformed}), do: "#{lost} lost, #{malformed} malformed"
  defp describe(%{too_large: too_large}), do: "#{too_large} too large"
  defp describe(nil), do: ""
  # A payload type of the robot's own.
  defp describe(payload), do: Payload.line(payload)

  defp length_of(%Vec3{x: x, y: y, z: z}), do: :math.sqrt(x * x + y * y + z * z)
  defp decimal(number), do: :erlang.float_to_binary(number, decimals: 2)

  defp topics(view) do
    for {name, {counter, info}} <- Enum.sort(view.observation.topics) do
      lost = info.readers |> Enum.map(& &1.lost) |> Enum.sum()

      [
        name,
        info.state,
        Float.round(Counter.rate(counter), 1),
        counter.count,
        lost,
        length(info.readers)
      ]
    end
  end

  defp vision_line(%{observation: observation}) do
    latency =
      case {Latency.quantile_us(observation.latency, 0.5),
            Latency.quantile_us(observation.latency, 0.99)} do
        {nil, nil} -> ""
        {p50, p99} -> ", latency: p50 #{ms(p50)}, p99 #{ms(p99)}"
      end

    "vision: #{observation.frames} frames, #{observation.detections} tags seen#{latency}\n"
  end

  defp row([name, state, hz, declared_hz, age, restarts, value]) do
    [
      pad(name, 15),
      pad(state, 8),
      lead(hz, 7),
      lead(declared_hz, 6),
      lead(age, 8),
      lead(restarts, 9),
      "  ",
      Table.cut(to_string(value), 25),
      "\n"
    ]
  end

  defp topic_row([name, state, hz, count, lost, readers], width) do
    [
      pad(name, width),
      pad(state, 8),
      lead(hz, 7),
      lead(count, 8),
      lead(lost, 8),
      lead(readers, 10),
      "\n"
    ]
  end

  defp pad(text, width), do: text |> to_string() |> String.pad_trailing(width)
  defp lead(nil, width), do: lead("-", width)
  defp lead(text, width), do: text |> to_string() |> String.pad_leading(width)

  defp ms(us), do: "#{Float.round(us / 1000, 1)} ms"
end

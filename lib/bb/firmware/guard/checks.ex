defmodule BB.Firmware.Guard.Checks do
  @moduledoc """
  The checks of a guard, in a struct that the guard's process has. They turn messages and the
  states of components into the events of `BB.Firmware.Guard.Validation`.

    * `{:sensor, name}` for each required sensor - good with a fresh reading, bad when the sensor
      is down or was started again. Its `max_silence` and its rate may allow older readings than
      `fresh_ms`
    * `{:native, name}` for each native process, outlet and inlet - good when it is up and was not
      started again
    * `:pubsub`, `:ring` - good when a message of the guard has returned to it
    * `:network` - good when the network has the required reach

  A check never waits and never raises: a check that fails by itself is bad.
  """
  @moduledoc no_example: "internal: BB.Firmware.Guard is its interface"

  alias BB.Firmware.Network.Adapter
  alias BB.{Message, PubSub, Ring, Sensor}
  alias BB.Message.Firmware.RoundTrip

  @path [:firmware, :guard]

  # These sensors publish nothing at their own path.
  @silent [BB.Handoff.Inlet, BB.Handoff.Outlet, BB.Sensor.NativeProcess]

  # The greatest age of a reading in periods of its sensor.
  @periods 2.5

  @enforce_keys [:robot, :topic, :network, :reach, :fresh_ms, :sensors, :silent]
  defstruct [
    :robot,
    :topic,
    :network,
    :reach,
    :fresh_ms,
    :sensors,
    :silent,
    :bus,
    :ring,
    token: 0,
    restarts: %{},
    max_silence_ns: %{}
  ]

  @type t :: %__MODULE__{}
  @type event :: BB.Firmware.Guard.Validation.event()

  @doc """
  Makes the checks of a robot.

  Options: `topic:` a ring topic of the guard alone, `network:` an adapter, `reach:` `:lan`,
  `:internet`, or `:none` for no check of the network, and `fresh_ms:`.
  """
  @spec new(module(), keyword()) :: t()
  def new(robot, opts) do
    sensors = for %{kind: Sensor} = component <- robot.robot().components, do: component
    {silent, speaking} = Enum.split_with(sensors, &(&1.module in @silent))

    struct!(
      __MODULE__,
      [
        robot: robot,
        sensors:
          for(%{required: true} = s <- speaking, into: %{}, do: {[:sensor | s.path], s.name}),
        silent: Enum.map(silent, & &1.name),
        max_silence_ns: Map.new(speaking, &{&1.name, &1.max_silence_ns || 0})
      ] ++ opts
    )
  end

  @doc "Returns the required checks."
  @spec required(t()) :: [BB.Firmware.Guard.Validation.check()]
  def required(checks) do
    Enum.sort(for {_path, name} <- checks.sensors, do: {:sensor, name}) ++
      for(name <- checks.silent, do: {:native, name}) ++
      [:pubsub, :ring] ++ if(checks.reach == :none, do: [], else: [:network])
  end

  @doc "Runs all checks, and sends the messages that must return."
  @spec run(t()) :: {t(), [event()]}
  def run(checks) do
    checks = %{checks | token: checks.token + 1}
    {checks, health} = health(checks)
    {checks, bus} = bus(checks)
    {checks, ring} = ring(checks)
    {checks, health ++ bus ++ ring ++ network(checks)}
  end

  @doc "Handles a message to the guard, and returns its events."
  @spec handle_message(t(), term()) :: [event()]
  def handle_message(%{token: token}, {:bb, @path, %{payload: %RoundTrip{token: token}}}),
    do: [{:good, :pubsub}]

  def handle_message(checks, {:bb, path, message}) do
    age_ns = System.monotonic_time(:nanosecond) - message.monotonic_time

    case checks.sensors do
      %{^path => name} when age_ns <= checks.fresh_ms * 1_000_000 -> [{:good, {:sensor, name}}]
      _ -> []
    end
  end

  def handle_message(
        %{ring: {_, %{ref: ref}}, token: token},
        {:bb_ring, ref, %Ring.Message{data: data}}
      ),
      do: if(data == <<token::64>>, do: [{:good, :ring}], else: [])

  def handle_message(_checks, _message), do: []

  @doc "Ends the subscriptions and closes the ring topic."
  @spec close(t()) :: t()
  def close(checks) do
    for path <- [@path | Map.keys(checks.sensors)], do: PubSub.unsubscribe(checks.robot, path)
    %{close_ring(checks) | bus: nil}
  end

  @doc "Returns the sensors that are not required and not up, each with a reason."
  @spec missing(t()) :: [{BB.Firmware.Guard.Validation.check(), String.t()}]
  def missing(checks) do
    required = required(checks)

    for row <- rows(checks.robot),
        check = {:sensor, row.name},
        check not in required and {:native, row.name} not in required,
        row.state != :up,
        do: {check, format_row(row)}
  end

  # The components

  defp health(checks) do
    rows = rows(checks.robot)
    known = Map.new(rows, &{&1.name, &1})

    sensors =
      for {_path, name} <- checks.sensors, do: sensor_events({:sensor, name}, known[name], checks)

    natives = for name <- checks.silent, do: component_event({:native, name}, known[name], checks)
    restarts = Map.new(rows, &{&1.name, &1.restarts})
    {%{checks | restarts: restarts}, List.flatten(sensors) ++ natives}
  end

  defp rows(robot) do
    Sensor.health(robot)
  rescue
    ArgumentError -> []
  end

  # Fresh readings alone make a sensor good. A slow sensor stays good until its last reading is
  # too old.
  defp sensor_events(check, row, checks) do
    case component_event(check, row, checks) do
      {:good, _check} -> if slow_and_fresh?(row, checks), do: [{:good, check}], else: []
      bad -> [bad]
    end
  end

  defp slow_and_fresh?(%{age_ns: nil}, _checks), do: false

  defp slow_and_fresh?(row, checks) do
    allowed_ns = max(checks.max_silence_ns[row.name] || 0, periods_ns(row.declared_hz))
    allowed_ns > checks.fresh_ms * 1_000_000 and row.age_ns <= allowed_ns
  end

  defp periods_ns(hz) when is_number(hz) and hz > 0, do: @periods * 1.0e9 / hz
  defp periods_ns(_hz), do: 0

  defp component_event(check, nil, _checks), do: {:bad, check, "the robot is not started"}

  defp component_event({_, name} = check, %{state: :up} = row, checks) do
    if row.restarts > Map.get(checks.restarts, name, row.restarts),
      do: {:bad, check, "was started again: #{format_row(%{row | reason: row.last_error})}"},
      else: {:good, check}
  end

  defp component_event(check, row, _checks), do: {:bad, check, format_row(row)}

  defp format_row(%{reason: nil, state: state}), do: to_string(state)
  defp format_row(row), do: "#{row.state}: #{row.error}"

  # The bus. Subscriptions end with the robot's root.

  defp bus(checks) do
    checks = subscribe(checks, Process.whereis(checks.robot))
    message = Message.new!(RoundTrip, :firmware_guard, token: checks.token)
    :ok = PubSub.publish(checks.robot, @path, message)
    {checks, []}
  rescue
    error in ArgumentError -> {%{checks | bus: nil}, [{:bad, :pubsub, Exception.message(error)}]}
  catch
    :exit, reason -> {%{checks | bus: nil}, [{:bad, :pubsub, {:exit, reason}}]}
  end

  defp subscribe(%{bus: bus} = checks, bus) when is_pid(bus), do: checks

  defp subscribe(checks, bus) do
    {:ok, _} = PubSub.subscribe(checks.robot, @path, exact: true)
    rate_hz = max(10, 10_000 / checks.fresh_ms)

    for path <- Map.keys(checks.sensors),
        do: {:ok, _} = PubSub.subscribe(checks.robot, path, exact: true, max_rate: rate_hz)

    %{checks | bus: bus}
  end

  # The ring

  defp ring(%{ring: nil} = checks) do
    with {:ok, publisher} <- Ring.Publisher.open(checks.topic, depth: 4, max_message_size: 64),
         {:ok, subscriber} <- open_subscriber(checks.topic, publisher) do
      ring(%{checks | ring: {publisher, subscriber}})
    else
      {:error, reason} -> {checks, [{:bad, :ring, Ring.format_error(reason)}]}
    end
  end

  defp ring(%{ring: {publisher, _subscriber}} = checks) do
    case Ring.Publisher.publish(publisher, <<checks.token::64>>) do
      :ok -> {checks, []}
      {:error, reason} -> {close_ring(checks), [{:bad, :ring, Ring.format_error(reason)}]}
    end
  end

  defp open_subscriber(topic, publisher) do
    with {:error, reason} <- Ring.Subscriber.open(topic, active: true) do
      :ok = Ring.Publisher.close(publisher)
      {:error, reason}
    end
  end

  defp close_ring(%{ring: nil} = checks), do: checks

  defp close_ring(%{ring: {publisher, subscriber}} = checks) do
    _ = Ring.Subscriber.close(subscriber)
    _ = Ring.Publisher.close(publisher)
    %{checks | ring: nil}
  end

  # The network

  defp network(%{reach: :none}), do: []

  defp network(checks) do
    state = Adapter.state(checks.network)

    if Adapter.reaches?(state, checks.reach),
      do: [{:good, :network}],
      else: [{:bad, :network, "#{state}, and #{checks.reach} is required"}]
  end
end

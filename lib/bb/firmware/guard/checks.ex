defmodule BB.Firmware.Guard.Checks do
  @moduledoc """
  What a guard looks at, as a value that the guard's process keeps. Messages and looks become the events of
  `BB.Firmware.Guard.Validation`.

    * `{:sensor, name}` - of each required sensor: a sample that is fresh; being down, or having
      been started again, is bad. Fresh is what its own `max_silence` and rate allow, where that
      is more than `fresh_ms`
    * `{:native, name}` - of each native process, outlet and inlet: it is up, and was not started again
    * `:pubsub`, `:ring` - what the guard sent to itself has come back
    * `:network` - it reaches as far as was asked for

  A look never waits and never raises: what cannot be looked at is bad.
  """

  alias BB.Firmware.Network.Adapter
  alias BB.{Message, PubSub, Ring, Sensor}
  alias BB.Message.Firmware.RoundTrip

  @path [:firmware, :guard]

  # They publish nothing at their own path.
  @silent [BB.Handoff.Inlet, BB.Handoff.Outlet, BB.Sensor.NativeProcess]

  # Samples come late at times: so many periods may pass.
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
  Of a robot. Options: `topic:` of the ring, for the guard alone; `network:` a source; `reach:` `:lan`, `:internet`, or `:none` for no look at
  the network; `fresh_ms:`.
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

  @doc "The checks that are required."
  @spec required(t()) :: [BB.Firmware.Guard.Validation.check()]
  def required(checks) do
    Enum.sort(for {_path, name} <- checks.sensors, do: {:sensor, name}) ++
      for(name <- checks.silent, do: {:native, name}) ++
      [:pubsub, :ring] ++ if(checks.reach == :none, do: [], else: [:network])
  end

  @doc "Looks at everything, and sends what is to come back."
  @spec look(t()) :: {t(), [event()]}
  def look(checks) do
    checks = %{checks | token: checks.token + 1}
    {checks, health} = health(checks)
    {checks, bus} = bus(checks)
    {checks, ring} = ring(checks)
    {checks, health ++ bus ++ ring ++ network(checks)}
  end

  @doc "What a message to the guard says, if it is one of the checks'."
  @spec heard(t(), term()) :: [event()]
  def heard(%{token: token}, {:bb, @path, %{payload: %RoundTrip{token: token}}}),
    do: [{:good, :pubsub}]

  def heard(checks, {:bb, path, message}) do
    age_ns = System.monotonic_time(:nanosecond) - message.monotonic_time

    case checks.sensors do
      %{^path => name} when age_ns <= checks.fresh_ms * 1_000_000 -> [{:good, {:sensor, name}}]
      _ -> []
    end
  end

  def heard(%{ring: {_, %{ref: ref}}, token: token}, {:bb_ring, ref, %Ring.Message{data: data}}),
    do: if(data == <<token::64>>, do: [{:good, :ring}], else: [])

  def heard(_checks, _message), do: []

  @doc "Ends what was begun: subscriptions, and the topic of the ring."
  @spec close(t()) :: t()
  def close(checks) do
    for path <- [@path | Map.keys(checks.sensors)], do: PubSub.unsubscribe(checks.robot, path)
    %{close_ring(checks) | bus: nil}
  end

  @doc "Sensors that are not required and not up, with the reason in words."
  @spec missing(t()) :: [{BB.Firmware.Guard.Validation.check(), String.t()}]
  def missing(checks) do
    required = required(checks)

    for row <- rows(checks.robot),
        check = {:sensor, row.name},
        check not in required and {:native, row.name} not in required,
        row.state != :up,
        do: {check, words(row)}
  end

  # The components

  defp health(checks) do
    rows = rows(checks.robot)
    known = Map.new(rows, &{&1.name, &1})

    sensors =
      for {_path, name} <- checks.sensors, do: trouble({:sensor, name}, known[name], checks)

    natives = for name <- checks.silent, do: standing({:native, name}, known[name], checks)
    restarts = Map.new(rows, &{&1.name, &1.restarts})
    {%{checks | restarts: restarts}, List.flatten(sensors) ++ natives}
  end

  defp rows(robot) do
    Sensor.health(robot)
  rescue
    ArgumentError -> []
  end

  # A sensor is good by its samples alone. One that is slow by nature is so as long as the last is
  # not too old.
  defp trouble(check, row, checks) do
    case standing(check, row, checks) do
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

  defp standing(check, nil, _checks), do: {:bad, check, "the robot is not started"}

  defp standing({_, name} = check, %{state: :up} = row, checks) do
    if row.restarts > Map.get(checks.restarts, name, row.restarts),
      do: {:bad, check, "was started again: #{words(%{row | reason: row.last_error})}"},
      else: {:good, check}
  end

  defp standing(check, row, _checks), do: {:bad, check, words(row)}

  defp words(%{reason: nil, state: state}), do: to_string(state)
  defp words(row), do: "#{row.state}: #{row.error}"

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
      else: [{:bad, :network, "#{state}, and #{checks.reach} is wanted"}]
  end
end

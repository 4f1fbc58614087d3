defmodule Ganglion.Console.Rows do
  @moduledoc """
  Builds the rows of the console's tables from the state of a robot, the ring and the buses.

  `Ganglion.Console` prints them with `Ganglion.Console.Table`.

      Ganglion.Console.Rows.sensors(Ganglion.Robot)
      #=> [[:imu, :up, 100.0, 100, "3 ms", 0], ...]
  """

  alias BB.Bus.I2C
  alias BB.{Parameter, PubSub, Ring, Sensor}
  alias Ganglion.Console.{Plain, Table}

  @segment "conduit_"
  @i2c_timeout_ms 20

  @doc "Returns a row for the health of one sensor."
  @spec sensor(map()) :: [Table.cell()]
  def sensor(row) do
    [row.name, row.state, row.rate_hz, row.declared_hz, Table.age(row.age_ns), row.restarts]
  end

  @doc "Returns a row for each sensor, actuator and controller of a robot."
  @spec components(module()) :: [[Table.cell()]]
  def components(robot) do
    for kind <- [Sensor, BB.Actuator, BB.Controller, BB.Estimator], row <- kind.health(robot) do
      required = if row.required, do: "yes", else: "no"
      [row.name, required, row.state, row.restarts, last_error(row)]
    end
  end

  @doc "Returns a row for each stream on a robot's pubsub."
  @spec streams(module()) :: [[Table.cell()]]
  def streams(robot) do
    for topic <- PubSub.topics(robot) do
      type = topic.type |> inspect() |> String.replace_prefix("BB.Message.", "")
      [path(topic.path), type, topic.rate_hz, topic.count, Table.age(topic.age_ns)]
    end
  end

  @doc "Returns a row for each parameter of a robot at and below a path."
  @spec parameters(module(), [atom()]) :: [[Table.cell()]]
  def parameters(robot, prefix) do
    for {path, parameter} <- Parameter.list(robot, prefix: prefix) do
      [path(path) | Enum.map([parameter.value, parameter.default, parameter.type], &inspect/1)]
    end
  end

  @doc "Returns a row for each topic in shared memory."
  @spec ring_topics() :: [[Table.cell()]]
  def ring_topics do
    for file <- Enum.sort(Path.wildcard(Path.join(ring_directory(), @segment <> "*"))),
        topic = file |> Path.basename() |> String.replace_prefix(@segment, ""),
        do: ring_topic(topic, Ring.info(topic))
  end

  # The same rule as in conduit_ring.
  defp ring_directory do
    case System.get_env("CONDUIT_RING_DIR") do
      unset when unset in [nil, ""] -> "/dev/shm"
      directory -> directory
    end
  end

  defp ring_topic(topic, {:ok, info}) do
    lost = for %{lost: lost} when lost != nil <- info.readers, do: lost

    [
      topic,
      info.state,
      info.published,
      info.slot_count,
      info.max_message_size,
      length(info.readers),
      Enum.max(lost, fn -> 0 end)
    ]
  end

  defp ring_topic(topic, {:error, reason}),
    do: [topic, Ring.format_error(reason), nil, nil, nil, nil, nil]

  @doc "Returns a row with the addresses that answer for each I2C bus, or for the named one."
  @spec i2c_buses(String.t() | nil) :: [[Table.cell()]]
  def i2c_buses(bus) do
    for name <- List.wrap(bus || I2C.bus_names()), do: [name, addresses(name)]
  end

  defp addresses(name) do
    with {:ok, bus} <- I2C.open(name, timeout: @i2c_timeout_ms) do
      found = I2C.detect_devices(bus)
      :ok = I2C.close(bus)
      if found == [], do: "no address answers", else: Enum.map_join(found, " ", &hex/1)
    else
      {:error, reason} -> "cannot be opened: #{Plain.format_error(reason)}"
    end
  end

  defp hex(address), do: "0x" <> Base.encode16(<<address>>)

  @doc """
  Returns a path as text.

      iex> Ganglion.Console.Rows.path([:sensor, :base_link, :imu])
      "sensor/base_link/imu"
  """
  @spec path([atom()]) :: String.t()
  def path(path), do: Enum.map_join(path, "/", &to_string/1)

  defp last_error(%{error: nil}), do: nil
  defp last_error(%{reason: nil} = row), do: "was: " <> row.error
  defp last_error(row), do: row.error
end

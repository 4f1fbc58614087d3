defmodule Ganglion.Console do
  @moduledoc """
  What a person types who has logged in to a running robot. `/etc/iex.exs` imports it there.

  | look | |
  |---|---|
  | `sensors()` | each sensor: state, rate, age of its last message, and what is wrong |
  | `health()` | each component that can be down, and why it is or was |
  | `watch [:sensor, :base_link]` | what is published there, for ten seconds |
  | `topics()` | every source on the pubsub |
  | `ring()` | every topic in shared memory |
  | `params()` | the parameters and their values |
  | `firmware()` | what runs here, whether it stays, and why the one before did not |
  | `i2c_scan()` | which addresses answer on the I²C buses |

  | act | |
  |---|---|
  | `arm()`, `disarm()` | let the robot move, make it safe |
  | `estop()`, `release()` | make it safe and keep it so, until released |

  The parentheses belong to them: without, Elixir takes the word for a variable. Each takes a robot as its last argument;
  without one it is that of the configuration (`config :ganglion, :robot`), or `Ganglion.Robot`.
  They print, fit 80 columns, return nothing of interest, and never raise: what goes wrong is a line that says so.
  """

  alias BB.Bus.I2C
  alias BB.Firmware.{Board, Guard}
  alias BB.Firmware.Guard.Report
  alias BB.{Parameter, PubSub, Ring, Safety, Sensor}
  alias Ganglion.Console.Table

  @estop [:console, :estop]
  @segment "conduit_"
  @watch_seconds 10
  @watch_rate_hz 5
  @i2c_timeout_ms 20

  @typedoc "What IEx does not show."
  @type printed :: :"do not show this result in output"

  @doc "Each sensor: its state, its rate and the one it declares, the age of its last message, and below it what is or was wrong with it."
  @spec sensors(module()) :: printed()
  def sensors(robot \\ robot()) do
    safely(fn ->
      rows = Sensor.health(robot)
      print(~w(sensor state Hz declared age restarts), Enum.map(rows, &sensor_row/1))
      for row <- rows, do: IO.write(Table.trouble(row))
    end)
  end

  @doc "Each sensor, actuator and controller with its state, and the reason for which it is down or was last."
  @spec health(module()) :: printed()
  def health(robot \\ robot()) do
    table(~w(component required state restarts reason), fn ->
      for kind <- [Sensor, BB.Actuator, BB.Controller], row <- kind.health(robot) do
        [row.name, if(row.required, do: "yes", else: "no"), row.state, row.restarts, why(row)]
      end
    end)
  end

  @doc "Every source on the pubsub: path, payload, rate, count and age."
  @spec topics(module()) :: printed()
  def topics(robot \\ robot()) do
    table(~w(path payload Hz messages age), fn ->
      for topic <- PubSub.topics(robot),
          do: [
            path(topic.path),
            short(topic.type),
            topic.rate_hz,
            topic.count,
            Table.age(topic.age_ns)
          ]
    end)
  end

  @doc "Every topic in shared memory: state, messages, readers and what the slowest of them has lost."
  @spec ring() :: printed()
  def ring do
    table(~w(topic state messages slots bytes readers lost), fn ->
      for file <- Enum.sort(Path.wildcard(Path.join(ring_directory(), @segment <> "*"))),
          topic = file |> Path.basename() |> String.replace_prefix(@segment, ""),
          do: ring_row(topic, Ring.info(topic))
    end)
  end

  @doc "The parameters at and below a path, with value and default."
  @spec params([atom()], module()) :: printed()
  def params(prefix \\ [], robot \\ robot()) do
    table(~w(parameter value default type), fn ->
      for {path, parameter} <- Parameter.list(robot, prefix: prefix),
          do: [
            path(path),
            inspect(parameter.value),
            inspect(parameter.default),
            inspect(parameter.type)
          ]
    end)
  end

  @doc "What is published at a path and below, one line a message. Options: `seconds:` (10), `rate:` lines a second from one source (5), `robot:`."
  @spec watch([atom()], keyword()) :: printed()
  def watch(path, opts \\ []) do
    safely(fn ->
      opts =
        Keyword.validate!(opts, seconds: @watch_seconds, rate: @watch_rate_hz, robot: robot())

      until = System.monotonic_time(:millisecond) + round(opts[:seconds] * 1_000)

      # A process of its own, so that the console's mailbox stays empty.
      watcher = Task.async(fn -> safely(fn -> watch(path, opts, until) end) end)
      _ = Task.await(watcher, :infinity)
      IO.puts("watched for #{opts[:seconds]} s")
    end)
  end

  @doc "What firmware runs, whether it stays, what its guard waits for, and why the last one that was reverted was."
  @spec firmware(GenServer.server(), Path.t()) :: printed()
  def firmware(guard \\ Guard, folder \\ guard_folder()) do
    safely(fn ->
      board = Board.configured()
      rows = for {name, value} <- Enum.sort(Board.firmware(board)), do: [name, value]

      rows =
        rows ++
          [["validation", words(Board.validation_status(board))]] ++
          guard_rows(Guard.state(guard))

      IO.write(Table.render(["firmware", ""], rows))
      if text = Report.read(folder, :reverted), do: print_report(text)
    end)
  end

  @doc "Arms the robot."
  @spec arm(module()) :: printed()
  def arm(robot \\ robot()), do: safely(fn -> say(Safety.arm(robot), robot) end)

  @doc "Disarms the robot."
  @spec disarm(module()) :: printed()
  def disarm(robot \\ robot()), do: safely(fn -> say(Safety.disarm(robot), robot) end)

  @doc "Disarms the robot and forbids arming, until `release/1`."
  @spec estop(module()) :: printed()
  def estop(robot \\ robot()) do
    safely(fn ->
      :ok = Safety.inhibit(robot, @estop, :estop)
      _ = say(Safety.disarm(robot), robot)
      IO.puts("arming is forbidden until release")
    end)
  end

  @doc "Allows arming again after `estop/1`."
  @spec release(module()) :: printed()
  def release(robot \\ robot()) do
    safely(fn ->
      :ok = Safety.allow(robot, @estop)
      say(:ok, robot)
    end)
  end

  @doc "Which addresses answer on each I²C bus, or on one of them."
  @spec i2c_scan(String.t() | nil) :: printed()
  def i2c_scan(bus \\ nil) do
    table(~w(bus addresses), fn ->
      for name <- List.wrap(bus || I2C.bus_names()), do: [name, addresses(name)]
    end)
  end

  @doc "Rows for the message of the day, as `config :nerves_motd, extra_rows:` wants them."
  @spec motd_rows(module()) :: [[{String.t(), String.t()}]]
  def motd_rows(robot \\ robot()) do
    [
      [
        {"Robot", quietly(fn -> to_string(Safety.state(robot)) end)},
        {"Sensors", quietly(fn -> sensors_up(Sensor.health(robot)) end)}
      ],
      [{"Firmware", quietly(fn -> words(Board.validation_status(Board.configured())) end)}]
    ]
  end

  # Rows

  defp sensor_row(row) do
    [row.name, row.state, row.rate_hz, row.declared_hz, Table.age(row.age_ns), row.restarts]
  end

  defp why(%{error: nil}), do: nil
  defp why(%{reason: nil} = row), do: "was: " <> row.error
  defp why(row), do: row.error

  defp path(path), do: Enum.map_join(path, "/", &to_string/1)
  defp short(module), do: module |> inspect() |> String.replace_prefix("BB.Message.", "")

  # As the ring itself finds it.
  defp ring_directory do
    case System.get_env("CONDUIT_RING_DIR") do
      unset when unset in [nil, ""] -> "/dev/shm"
      directory -> directory
    end
  end

  defp ring_row(topic, {:ok, info}) do
    lost =
      info.readers |> Enum.map(& &1[:lost]) |> Enum.reject(&is_nil/1) |> Enum.max(fn -> 0 end)

    [
      topic,
      info.state,
      info.published,
      info.slot_count,
      info.max_message_size,
      length(info.readers),
      lost
    ]
  end

  defp ring_row(topic, {:error, reason}),
    do: [topic, Ring.format_error(reason), nil, nil, nil, nil, nil]

  defp addresses(name) do
    with {:ok, bus} <- I2C.open(name, timeout: @i2c_timeout_ms) do
      found = I2C.detect_devices(bus)
      :ok = I2C.close(bus)
      if found == [], do: "none answers", else: Enum.map_join(found, " ", &hex/1)
    else
      {:error, reason} -> "cannot be opened: #{inspect(reason)}"
    end
  end

  defp hex(address), do: "0x" <> Base.encode16(<<address>>)

  defp guard_rows({:ok, state}) do
    left = if state.left_ms, do: [["decides within", "#{div(state.left_ms, 1_000)} s"]], else: []
    reasons = for {check, reason} <- state.reasons, do: [Report.name(check), Report.words(reason)]
    missing = for {check, words} <- state.missing, do: [Report.name(check), "optional; " <> words]
    [["guard", state.phase]] ++ left ++ reasons ++ missing
  end

  defp guard_rows({:error, :not_running}), do: [["guard", "is not running"]]

  defp print_report(text) do
    IO.puts("\nthe last firmware that was reverted:")
    for line <- String.split(text, "\n", trim: true), do: IO.puts(Table.cut(line))
  end

  defp sensors_up(rows), do: "#{Enum.count(rows, &(&1.state == :up))} of #{length(rows)} up"

  defp words(status) when is_atom(status), do: to_string(status)
  defp words({:error, reason}), do: "not known: #{inspect(reason)}"

  # Watching

  defp watch(path, opts, until) do
    {:ok, _} = PubSub.subscribe(opts[:robot], path, max_rate: opts[:rate], max_queue: 100)
    show_until(until)
  end

  defp show_until(until) do
    receive do
      {:bb, path, message} ->
        IO.puts(Table.cut("#{path(path)} #{inspect(message.payload, limit: 20)}"))
        if until > System.monotonic_time(:millisecond), do: show_until(until)

      {:bb_missed, _path, count} ->
        IO.puts("#{count} messages were missed: the terminal is too slow")
        show_until(until)
    after
      max(0, until - System.monotonic_time(:millisecond)) -> :ok
    end
  end

  # Printing

  defp say(:ok, robot), do: IO.puts("#{inspect(robot)} is #{Safety.state(robot)}")

  defp say({:error, {:inhibited, inhibitions}}, _robot) do
    for {path, reason} <- inhibitions,
        do: IO.puts(Table.cut("refused: #{path(path)} forbids arming (#{inspect(reason)})"))
  end

  defp say({:error, {:disarm_failed, failures}}, _robot) do
    IO.puts("DISARMING FAILED: the hardware may not be safe")
    for {path, error} <- failures, do: IO.puts(Table.cut("#{path(path)}: #{inspect(error)}"))
  end

  defp say({:error, reason}, robot),
    do: IO.puts(Table.cut("refused, #{inspect(robot)}: #{reason}"))

  defp table(header, fun) do
    safely(fn -> print(header, fun.()) end)
  end

  defp print(_header, []), do: IO.puts("none")
  defp print(header, rows), do: IO.write(Table.render(header, rows))

  defp safely(fun) do
    _ = fun.()
    hidden()
  rescue
    error -> complain(Exception.message(error))
  catch
    kind, reason -> complain("#{kind}: #{inspect(reason)}")
  end

  defp complain(text) do
    IO.puts(Table.cut("that did not work: #{text}"))
    hidden()
  end

  defp hidden, do: :"do not show this result in output"

  # A message of the day that raised would be the whole message of the day.
  defp quietly(fun) do
    fun.()
  rescue
    _error -> "not running"
  catch
    _kind, _reason -> "not known"
  end

  defp robot, do: Application.get_env(:ganglion, :robot) || Ganglion.Robot

  defp guard_folder,
    do: Keyword.get(Application.get_env(:ganglion, Guard, []), :folder, "/data/guard")
end

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
  | `firmware()` | what runs here, whether it stays, what happened to it and the board |
  | `i2c_scan()` | which addresses answer on the I2C buses |

  | act | |
  |---|---|
  | `arm()`, `disarm()` | let the robot move, make it safe |
  | `estop()`, `release()` | make it safe and keep it so, until released |
  | `revert()` | start the firmware before this one, unless it was refused |

  The parentheses belong to them: without, Elixir takes the word for a variable. What is about a
  robot takes one as its last argument; without one it is that of the configuration (`config
  :ganglion, :robot`), or `Ganglion.Robot`. They print, fit 80 columns, return nothing of
  interest, and never raise: what goes wrong is a line that says so.

  What they print is ASCII, whatever it tells of: a command over ssh (`ssh host
  'Ganglion.Console.sensors()'`) drops each write with a character that Latin-1 does not have.
  """

  alias BB.Bus.I2C
  alias BB.Firmware.{Board, Gate, Guard, Robots, Story, Trial}
  alias BB.Firmware.Trial.Findings
  alias BB.{Parameter, PubSub, Ring, Safety, Sensor}
  alias Ganglion.Console.{Plain, Reading, Table}

  @estop [:console, :estop]
  @segment "conduit_"
  @watch_seconds 10
  @watch_rate_hz 5
  @i2c_timeout_ms 20
  @events 8

  @typedoc "What IEx does not show; `:ok` where it is not IEx that asks."
  @type printed :: :"do not show this result in output" | :ok

  @doc "Each sensor: its state, its rate and the one it declares, the age of its last message, and below it what is or was wrong with it."
  @spec sensors(module()) :: printed()
  def sensors(robot \\ robot()) do
    safely(fn ->
      rows = Sensor.health(robot)
      print(~w(sensor state Hz declared age restarts), Enum.map(rows, &sensor_row/1))
      for row <- rows, do: put(Table.trouble(row))
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
      say("watched for #{opts[:seconds]} s")
    end)
  end

  @doc """
  What firmware runs, whether it stays, what its guard waits for, why the last one that was
  reverted was, and what happened to the board of late.
  """
  @spec firmware(GenServer.server(), Path.t()) :: printed()
  def firmware(guard \\ Guard, folder \\ Guard.folder()) do
    safely(fn ->
      board = Board.configured()
      rows = for {name, value} <- Enum.sort(Board.firmware(board)), do: [name, value]

      rows =
        rows ++
          [["validation", validation(folder, board)]] ++
          other_rows(folder, board) ++ guard_rows(Guard.state(guard)) ++ application_rows()

      put(Table.render(["firmware", ""], rows))
      _ = if text = Findings.read(folder, :reverted), do: print_report(text)
      print_story(Story.recent(folder, @events))
    end)
  end

  @doc """
  Restarts the board with the firmware before this one, the one in the other slot. In the place of
  `Nerves.Runtime.revert/1`.

  Refused while a robot is armed or an update is written, where there is no other firmware, and
  for firmware that was on trial once and did not stay: it would run without a trial. What is left
  then is an update.
  """
  @spec revert(Path.t()) :: printed()
  def revert(folder \\ Guard.folder()) do
    safely(fn ->
      board = Board.configured()

      with :ok <- still(Robots.state(Robots.known())),
           :ok <- idle(Gate.busy?()),
           {:ok, version} <- other(folder, Board.other(board)) do
        say("the board restarts with the firmware #{version}")
        by = "a person, on the console"

        with {:error, reason} <- Trial.revert(folder, board, by, []),
             do: say("the board did not revert: #{Plain.words(reason)}")
      else
        {:refused, why} -> say("refused: #{why}")
      end
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
      say("arming is forbidden until release")
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

  @doc "Which addresses answer on each I2C bus, or on one of them."
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
        {"Robot", quietly(fn -> robot_state(robot) end)},
        {"Sensors", quietly(fn -> sensors_up(Sensor.health(robot)) end)}
      ],
      [{"Guard", quietly(fn -> guard_line(Guard.state()) end)}]
    ] ++ for([_application, trouble] <- application_rows(), do: [{"Trouble", trouble}])
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
      {:error, reason} -> "cannot be opened: #{Plain.words(reason)}"
    end
  end

  defp hex(address), do: "0x" <> Base.encode16(<<address>>)

  defp guard_rows({:ok, state}) do
    left = if state.left_ms, do: [["decides within", "#{div(state.left_ms, 1_000)} s"]], else: []

    reasons =
      for {check, reason} <- state.reasons,
          do: [Findings.format_check(check), Findings.format_reason(reason)]

    missing =
      for {check, words} <- state.missing,
          do: [Findings.format_check(check), "optional; " <> words]

    [["guard", state.phase]] ++ left ++ reasons ++ missing
  end

  defp guard_rows({:error, :not_running}), do: [["guard", "is not running"]]

  # In a word, beside the board's own line about its firmware.
  defp guard_line({:ok, %{left_ms: left_ms}}) when is_integer(left_ms),
    do: "firmware on trial, decides within #{div(left_ms, 1_000)} s"

  defp guard_line({:ok, %{phase: :reverting}}), do: "this firmware is reverted"
  defp guard_line({:ok, _state}), do: "this firmware stays"
  defp guard_line({:error, :not_running}), do: "not running"

  defp validation(folder, board) do
    case {Trial.status(folder, board), Board.validation_status(board)} do
      {:unvalidated, status} when status != :unvalidated -> "on trial, by the guard alone"
      {status, _of_the_board} -> status(status)
    end
  end

  defp other_rows(folder, board) do
    case Board.other(board) do
      %{"nerves_fw_uuid" => uuid} = other ->
        refused = if Trial.refused?(folder, uuid), do: ", which was refused", else: ""
        [["other slot", "#{other["nerves_fw_version"]}#{refused}"]]

      _nothing ->
        []
    end
  end

  # What belongs to a robot is not there either, and says nothing of why.
  defp application_rows do
    if Process.whereis(Ganglion.Supervisor),
      do: [],
      else: [["application", "ganglion does not run; firmware() tells what happened"]]
  end

  defp print_report(text) do
    say("")
    say("the last firmware that was reverted:")
    for line <- String.split(text, "\n", trim: true), do: put(Table.wrap(line))
  end

  defp print_story([]), do: :ok

  defp print_story(lines) do
    say("")
    say("what happened:")
    for line <- lines, do: put(Table.wrap(line))
  end

  defp still(state) when state in [:disarmed, :error], do: :ok
  defp still(state), do: {:refused, "a robot is #{state}: disarm it first"}

  defp idle(false), do: :ok
  defp idle(true), do: {:refused, "an update is being written"}

  defp other(folder, %{"nerves_fw_uuid" => uuid} = other) do
    version = other["nerves_fw_version"] || uuid

    if Trial.refused?(folder, uuid),
      do: {:refused, "the firmware #{version} in the other slot did not stay when it was tried"},
      else: {:ok, version}
  end

  defp other(_folder, _nothing), do: {:refused, "there is no other firmware to go back to"}

  defp robot_state(robot) do
    if Process.whereis(robot), do: to_string(Safety.state(robot)), else: "not running"
  end

  defp sensors_up(rows), do: "#{Enum.count(rows, &(&1.state == :up))} of #{length(rows)} up"

  defp status(status) when is_atom(status), do: to_string(status)
  defp status({:error, reason}), do: "not known: #{Plain.words(reason)}"

  # Watching

  defp watch(path, opts, until) do
    {:ok, _} = PubSub.subscribe(opts[:robot], path, max_rate: opts[:rate], max_queue: 100)
    show_until(until)
  end

  defp show_until(until) do
    receive do
      {:bb, path, message} ->
        put(Table.wrap("#{path(path)} #{Reading.line(message.payload)}"))
        if until > System.monotonic_time(:millisecond), do: show_until(until)

      {:bb_missed, _path, count} ->
        say("#{count} messages were missed: the terminal is too slow")
        show_until(until)
    after
      max(0, until - System.monotonic_time(:millisecond)) -> :ok
    end
  end

  # Printing

  defp say(:ok, robot), do: say("#{inspect(robot)} is #{Safety.state(robot)}")

  defp say({:error, {:inhibited, inhibitions}}, _robot) do
    for {path, reason} <- inhibitions,
        do: say("refused: #{path(path)} forbids arming (#{inspect(reason)})")
  end

  defp say({:error, {:disarm_failed, failures}}, _robot) do
    say("DISARMING FAILED: the hardware may not be safe")
    for {path, error} <- failures, do: say("#{path(path)}: #{inspect(error)}")
  end

  defp say({:error, reason}, robot), do: say("refused, #{inspect(robot)}: #{reason}")

  defp say(line), do: put(Table.cut(line) <> "\n")

  # The one place that prints. Lines are plain already.
  defp put(lines), do: IO.write(lines)

  defp table(header, fun) do
    safely(fn -> print(header, fun.()) end)
  end

  defp print(_header, []), do: say("none")
  defp print(header, rows), do: put(Table.render(header, rows))

  defp safely(fun) do
    _ = fun.()
    hidden()
  rescue
    error -> complain(Exception.message(error))
  catch
    kind, reason -> complain("#{kind}: #{inspect(reason)}")
  end

  defp complain(text) do
    say("that did not work: #{text}")
    hidden()
  end

  # What evaluates a line of IEx has this in its dictionary. What runs a command over ssh prints
  # any result, and has not.
  defp hidden do
    if Process.get(:iex_server), do: :"do not show this result in output", else: :ok
  end

  # A message of the day that raised would be the whole message of the day.
  defp quietly(fun) do
    fun.()
  rescue
    _error -> "not running"
  catch
    _kind, _reason -> "not known"
  end

  defp robot, do: Application.get_env(:ganglion, :robot) || Ganglion.Robot
end

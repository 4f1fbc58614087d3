defmodule Ganglion.Console do
  @moduledoc """
  The commands of a robot's console.

  `/etc/iex.exs` imports this module on a board, for whoever logs in to a running robot.

      sensors()
      watch [:sensor, :base_link]

  | look | |
  |---|---|
  | `sensors()` | each sensor: state, rate, age of its last message, and its last error |
  | `health()` | each component, its state, and the reason why it is or was down |
  | `watch [:sensor, :base_link]` | the messages at and below that path, for ten seconds |
  | `topics()` | every stream on the pubsub: path and payload type |
  | `ring()` | every topic in shared memory |
  | `params()` | the parameters and their values |
  | `firmware()` | the firmware, its validation, and the latest events of the board |
  | `i2c_scan()` | the addresses that answer on the I2C buses |

  | act | |
  |---|---|
  | `arm()`, `disarm()` | allow the robot to move, make it safe |
  | `estop()`, `release()` | make it safe and forbid arming, allow arming again |
  | `revert()` | start the previous firmware, unless it was refused |

  The parentheses are necessary: Elixir reads a bare word as a variable. A command about a robot
  takes the robot as its last argument. The default is the robot of the configuration (`config
  :ganglion, :robot`), or else `Ganglion.Robot`.

  Each command prints lines of at most 80 columns and never raises: an error is a printed line.

  The output is ASCII. A command over ssh (`ssh host 'Ganglion.Console.sensors()'`) drops each
  write with a character beyond Latin-1.
  """

  alias BB.Firmware.{Board, Guard, Story, Trial}
  alias BB.{PubSub, Safety, Sensor}
  alias Ganglion.Console.{Firmware, Payload, Plain, Rows, Table}

  @estop [:console, :estop]
  @watch_seconds 10
  @watch_rate_hz 5
  @events 8

  @typedoc "A result that IEx does not show. Outside of IEx it is `:ok`."
  @type printed :: :"do not show this result in output" | :ok

  @doc """
  Prints each sensor: its state, its rate and declared rate, the age of its last message, and its
  last error.
  """
  @spec sensors(module()) :: printed()
  def sensors(robot \\ robot()) do
    rescued(fn ->
      rows = Sensor.health(robot)
      print(~w(sensor state Hz declared age restarts), Enum.map(rows, &Rows.sensor/1))
      for row <- rows, do: write(Table.trouble(row))
    end)
  end

  @doc "Prints the state of each sensor, actuator and controller, and its last error."
  @spec health(module()) :: printed()
  def health(robot \\ robot()) do
    table(~w(component required state restarts reason), fn -> Rows.components(robot) end)
  end

  @doc "Prints each stream on the pubsub: path, payload, rate, count and age."
  @spec topics(module()) :: printed()
  def topics(robot \\ robot()) do
    table(~w(path payload Hz messages age), fn -> Rows.streams(robot) end)
  end

  @doc """
  Prints each topic in shared memory: its state, its messages, its readers, and the largest number
  of messages that a reader has lost.
  """
  @spec ring() :: printed()
  def ring do
    table(~w(topic state messages slots bytes readers lost), &Rows.ring_topics/0)
  end

  @doc "Prints the parameters at and below a path, with value and default."
  @spec params([atom()], module()) :: printed()
  def params(prefix \\ [], robot \\ robot()) do
    table(~w(parameter value default type), fn -> Rows.parameters(robot, prefix) end)
  end

  @doc """
  Prints the messages that are published at and below a path, one line each.

  Options: `seconds:` (10), `rate:` lines a second from one path and payload type (5), `robot:`.
  """
  @spec watch([atom()], keyword()) :: printed()
  def watch(path, opts \\ []) do
    rescued(fn ->
      opts =
        Keyword.validate!(opts, seconds: @watch_seconds, rate: @watch_rate_hz, robot: robot())

      until = System.monotonic_time(:millisecond) + round(opts[:seconds] * 1_000)

      # Another process receives, so that the console's mailbox stays empty.
      watcher = Task.async(fn -> rescued(fn -> watch(path, opts, until) end) end)
      _ = Task.await(watcher, :infinity)
      print_line("watched for #{opts[:seconds]} s")
    end)
  end

  @doc """
  Prints the firmware, its validation, what its guard waits for, the report of the last firmware
  that was reverted, and the latest events of the board.
  """
  @spec firmware(GenServer.server(), Path.t()) :: printed()
  def firmware(guard \\ Guard, folder \\ Guard.folder()) do
    rescued(fn ->
      write(Table.render(["firmware", ""], Firmware.rows(guard, folder)))
      _ = if text = Firmware.last_report(folder), do: print_report(text)
      print_story(Story.recent(folder, @events))
    end)
  end

  @doc """
  Restarts the board with the previous firmware, from the other slot.

  Use it instead of `Nerves.Runtime.revert/1`. It refuses while a robot is armed or an update is
  being written, and if the other slot has no firmware. It also refuses firmware that failed its
  trial, because that firmware would run without a new one: send an update instead.
  """
  @spec revert(Path.t()) :: printed()
  def revert(folder \\ Guard.folder()) do
    rescued(fn ->
      case Firmware.check_revert(folder) do
        {:ok, version} ->
          print_line("the board restarts with the firmware #{version}")
          by = "a person, on the console"

          with {:error, reason} <- Trial.revert(folder, Board.configured(), by, []),
               do: print_line("the board did not revert: #{Plain.format_error(reason)}")

        {:refused, why} ->
          print_line("refused: #{why}")
      end
    end)
  end

  @doc "Arms the robot."
  @spec arm(module()) :: printed()
  def arm(robot \\ robot()), do: rescued(fn -> print_result(Safety.arm(robot), robot) end)

  @doc "Disarms the robot."
  @spec disarm(module()) :: printed()
  def disarm(robot \\ robot()), do: rescued(fn -> print_result(Safety.disarm(robot), robot) end)

  @doc "Disarms the robot and forbids arming, until `release/1`."
  @spec estop(module()) :: printed()
  def estop(robot \\ robot()) do
    rescued(fn ->
      :ok = Safety.inhibit(robot, @estop, :estop)
      _ = print_result(Safety.disarm(robot), robot)
      print_line("arming is forbidden until release")
    end)
  end

  @doc "Allows arming again after `estop/1`."
  @spec release(module()) :: printed()
  def release(robot \\ robot()) do
    rescued(fn ->
      :ok = Safety.allow(robot, @estop)
      print_result(:ok, robot)
    end)
  end

  @doc "Prints the addresses that answer on each I2C bus, or on the named one."
  @spec i2c_scan(String.t() | nil) :: printed()
  def i2c_scan(bus \\ nil) do
    table(~w(bus addresses), fn -> Rows.i2c_buses(bus) end)
  end

  @doc "Returns rows for the message of the day, for `config :nerves_motd, extra_rows:`."
  @spec motd_rows(module()) :: [[{String.t(), String.t()}]]
  def motd_rows(robot \\ robot()) do
    [
      [
        {"Robot", quietly(fn -> robot_state(robot) end)},
        {"Sensors", quietly(fn -> sensors_up(Sensor.health(robot)) end)}
      ],
      [{"Guard", quietly(&Firmware.guard_summary/0)}]
    ] ++ for([_application, trouble] <- Firmware.application_rows(), do: [{"Trouble", trouble}])
  end

  defp print_report(text) do
    print_line("")
    print_line("the last firmware that was reverted:")
    for line <- String.split(text, "\n", trim: true), do: write(Table.wrap(line))
  end

  defp print_story([]), do: :ok

  defp print_story(lines) do
    print_line("")
    print_line("latest events:")
    for line <- lines, do: write(Table.wrap(line))
  end

  defp robot_state(robot) do
    if Process.whereis(robot), do: to_string(Safety.state(robot)), else: "not running"
  end

  defp sensors_up(rows), do: "#{Enum.count(rows, &(&1.state == :up))} of #{length(rows)} up"

  # Watching

  defp watch(path, opts, until) do
    {:ok, _} = PubSub.subscribe(opts[:robot], path, max_rate: opts[:rate], max_queue: 100)
    show_until(until)
  end

  defp show_until(until) do
    receive do
      {:bb, path, message} ->
        write(Table.wrap("#{Rows.path(path)} #{Payload.line(message.payload)}"))
        if until > System.monotonic_time(:millisecond), do: show_until(until)

      {:bb_missed, _path, count} ->
        print_line("#{count} messages were missed: the terminal is too slow")
        show_until(until)
    after
      max(0, until - System.monotonic_time(:millisecond)) -> :ok
    end
  end

  # Printing

  defp print_result(:ok, robot), do: print_line("#{inspect(robot)} is #{Safety.state(robot)}")

  defp print_result({:error, {:inhibited, inhibitions}}, _robot) do
    for {path, reason} <- inhibitions,
        do: print_line("refused: #{Rows.path(path)} forbids arming (#{inspect(reason)})")
  end

  defp print_result({:error, {:disarm_failed, failures}}, _robot) do
    print_line("DISARMING FAILED: the hardware may not be safe")
    for {path, error} <- failures, do: print_line("#{Rows.path(path)}: #{inspect(error)}")
  end

  defp print_result({:error, reason}, robot),
    do: print_line("refused, #{inspect(robot)}: #{reason}")

  defp print_line(line), do: write(Table.cut(line) <> "\n")

  # Lines are ASCII already.
  defp write(lines), do: IO.write(lines)

  defp table(header, fun) do
    rescued(fn -> print(header, fun.()) end)
  end

  defp print(_header, []), do: print_line("none")
  defp print(header, rows), do: write(Table.render(header, rows))

  defp rescued(fun) do
    _ = fun.()
    hidden()
  rescue
    error -> print_error(Exception.message(error))
  catch
    kind, reason -> print_error("#{kind}: #{inspect(reason)}")
  end

  defp print_error(text) do
    print_line("command failed: #{text}")
    hidden()
  end

  # An IEx evaluator has this key in its process dictionary. A command over ssh runs without it,
  # and ssh prints every result.
  defp hidden do
    if Process.get(:iex_server), do: :"do not show this result in output", else: :ok
  end

  # An exception would replace the whole message of the day.
  defp quietly(fun) do
    fun.()
  rescue
    _error -> "not running"
  catch
    _kind, _reason -> "not known"
  end

  defp robot, do: Application.get_env(:ganglion, :robot) || Ganglion.Robot
end

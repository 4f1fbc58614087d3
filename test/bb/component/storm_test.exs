defmodule BB.Component.StormTest do
  @moduledoc """
  Faults of every kind on one sensor of a robot of twenty. `FAULTS=1000 mix test
  test/bb/component/storm_test.exs` makes as many, and also measures how long after each fault's
  end the sensor is up, less the time in which the VM stood still.
  """

  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Robot
  import BB.Test.Watch

  alias BB.Test.{Gaps, Probe, Standstill}

  @moduletag timeout: :infinity

  @siblings for n <- 1..19, do: :"sibling_#{n}"

  # `{name, script, trigger, further end}`. The last callback of a script fails.
  defp faults do
    [
      {"init raises", [init: fn _ -> raise "broken" end], &kill/1},
      {"init throws", [init: fn _ -> throw(:ball) end], &kill/1},
      {"init exits", [init: fn _ -> exit(:broken) end], &kill/1},
      {"init returns nonsense", [init: fn _ -> :nonsense end], &kill/1},
      {"init returns {:stop, reason}", [init: fn _ -> {:stop, :absent} end], &kill/1},
      {"init returns {:error, reason}", [init: fn _ -> {:error, :enodev} end], &kill/1},
      {"init is killed", [init: fn _ -> Process.exit(self(), :kill) end], &kill/1},
      {"init hangs", [init: fn opts -> receive(do: (:go_on -> {:ok, opts[:bb]})) end], &kill/1,
       &send(&1, :go_on)},
      {"init's continuation crashes",
       [
         init: fn _ -> {:ok, nil, {:continue, :go}} end,
         handle_continue: fn _, _ -> raise "broken" end
       ], &kill/1},
      {"handle_call crashes", [handle_call: fn _, _, _ -> raise "broken" end], &call/1},
      {"handle_call stops", [handle_call: fn _, _, s -> {:stop, :broken, s} end], &call/1},
      {"handle_cast crashes", [handle_cast: fn _, _ -> raise "broken" end], &cast/1},
      {"handle_cast stops, and terminate crashes",
       [
         handle_cast: fn _, s -> {:stop, :broken, s} end,
         terminate: fn _, _ -> raise "broken" end
       ], &cast/1},
      {"handle_info exits", [handle_info: fn _, _ -> exit(:broken) end],
       &BB.send(&1, :imu, :fail)},
      {"handle_options crashes", [handle_options: fn _, _ -> raise "broken" end], &set/1},
      {"handle_options stops", [handle_options: fn _, _ -> {:stop, :broken} end], &set/1},
      {"what is linked fails",
       [
         handle_cast: fn _, _ ->
           spawn_link(fn -> exit(:broken) end)
           Process.sleep(:infinity)
         end
       ], &cast/1},
      {"killed", [], &kill/1},
      {"hangs, and is killed", [handle_cast: fn _, _ -> Process.sleep(:infinity) end], &cast/1,
       &Process.exit(&1, :kill)}
    ]
  end

  defp kill(robot) do
    with pid when is_pid(pid) <- pid(robot, :imu), do: Process.exit(pid, :kill)
  end

  defp cast(robot), do: BB.cast(robot, :imu, :fail)
  defp call(robot), do: catch_exit(BB.call(robot, :imu, :fail))

  defp set(robot),
    do: BB.Parameter.set(robot, [:rate], BB.Parameter.get!(robot, [:rate]) + 1)

  defp twenty do
    create(
      quote do
        parameters do
          param :rate, type: :integer, default: 1
        end

        sensors do
          for name <- unquote(Enum.take(@siblings, 10)), do: sensor(name, BB.Test.Counter)
        end

        topology do
          link :base do
            sensor :imu, {BB.Test.Probe, rate: param([:rate])}
            for name <- unquote(Enum.drop(@siblings, 10)), do: sensor(name, BB.Test.Counter)
          end
        end
      end
    )
  end

  test "faults of one sensor of twenty cost no sibling a sample or its pid, restart no supervisor, " <>
         "and the sensor is up within 1 s of each fault's end" do
    robot = twenty()
    start_supervised!(robot)
    assert eventually(fn -> Enum.all?(BB.Sensor.health(robot), &(&1.state == :up)) end)
    {:ok, _} = BB.subscribe(robot, [:sensor_status])
    {:ok, gaps} = Gaps.start_link(robot)
    {:ok, standstill} = Standstill.start_link()
    supervisors = supervisors(robot)
    siblings = for name <- @siblings, do: pid(robot, name)

    recoveries =
      faults()
      |> Stream.cycle()
      |> Enum.take(count())
      |> Enum.map(fn fault -> strike(robot, fault, standstill) end)

    assert {heard, []} = Gaps.report(gaps)
    assert map_size(heard) == 19
    assert for(name <- @siblings, do: pid(robot, name)) == siblings
    assert supervisors(robot) == supervisors
    assert health(robot, :imu).restarts >= count()
    assert for(%{state: state} <- BB.Sensor.health(robot), do: state) == List.duplicate(:up, 20)

    retries = retries(robot, [])
    assert length(retries) >= count() and Enum.max(retries) <= 750

    if System.get_env("FAULTS") do
      slowest = recoveries |> Enum.sort_by(& &1.ms, :desc) |> Enum.take(5)
      IO.puts("\n#{count()} faults; the slowest recoveries, in milliseconds:")
      Enum.each(slowest, &IO.inspect/1)
      assert hd(slowest).ms <= 1_000
    end
  end

  defp count, do: String.to_integer(System.get_env("FAULTS") || "#{length(faults())}")

  # Returns the milliseconds from the fault's end until the sensor was up, less the standstill,
  # and the longest retry meanwhile.
  defp strike(robot, {name, script, set_off}, standstill),
    do: strike(robot, {name, script, set_off, fn _struck -> :ok end}, standstill)

  defp strike(robot, {name, script, set_off, relieve}, standstill) do
    before = pid(robot, :imu)
    _earlier = struck_last(nil)
    Probe.script(robot, :imu, telling(script))
    set_off.(robot)
    struck = struck(name, script, before)
    Probe.script(robot, :imu, heal(script))
    relieve.(struck)
    _before = Standstill.take(standstill)
    ended_ms = System.monotonic_time(:millisecond)
    retry_in_ms = await_up(robot, [before, failed(name, struck)], ended_ms, 0)
    standstill_ms = Standstill.take(standstill)
    ms = System.monotonic_time(:millisecond) - ended_ms - standstill_ms
    %{fault: name, ms: ms, standstill_ms: standstill_ms, retry_in_ms: retry_in_ms}
  end

  defp await_up(robot, gone, ended_ms, longest_ms) do
    row = health(robot, :imu)

    cond do
      row.state == :up and row.pid not in gone and pid(robot, :imu) == row.pid ->
        longest_ms

      System.monotonic_time(:millisecond) - ended_ms > 30_000 ->
        flunk("it is not up again: #{inspect(row)}")

      true ->
        Process.sleep(5)
        await_up(robot, gone, ended_ms, max(longest_ms, row.retry_in_ms || 0))
    end
  end

  # The last callback sends the test the process in which it fails.
  defp telling([]), do: []

  defp telling(script) do
    test = self()
    {healthy, [{callback, fun}]} = Enum.split(script, -1)
    tell = fn -> send(test, {:struck, self()}) end
    healthy ++ [{callback, after_telling(fun, tell)}]
  end

  defp after_telling(fun, tell) when is_function(fun, 1), do: &(tell.() && fun.(&1))
  defp after_telling(fun, tell) when is_function(fun, 2), do: &(tell.() && fun.(&1, &2))
  defp after_telling(fun, tell) when is_function(fun, 3), do: &(tell.() && fun.(&1, &2, &3))

  defp struck(_name, [], before), do: before

  defp struck(name, _script, _before) do
    assert_receive {:struck, pid}, 30_000, name
    struck_last(pid)
  end

  # A fault of init may occur more than once.
  defp struck_last(pid) do
    receive do
      {:struck, pid} -> struck_last(pid)
    after
      0 -> pid
    end
  end

  defp failed("init hangs", _struck), do: nil
  defp failed(_name, struck), do: struck

  defp retries(robot, found) do
    receive do
      {:bb, [:sensor_status | _], %{robot: ^robot, frame_id: :imu, payload: status}} ->
        retries(
          robot,
          if(status.state == :backoff, do: [status.retry_in_ms | found], else: found)
        )
    after
      0 -> found
    end
  end

  # The callbacks of a sensor without a fault.
  defp heal(script) do
    healthy = [
      init: fn opts -> {:ok, opts[:bb]} end,
      handle_call: fn _, _, s -> {:reply, :ok, s} end,
      handle_options: fn _, s -> {:ok, s} end,
      terminate: fn _, _ -> :ok end
    ]

    for {callback, _} <- script, do: {callback, healthy[callback] || fn _, s -> {:noreply, s} end}
  end
end

defmodule BB.Component.StormTest do
  @moduledoc """
  Faults of every kind on one sensor of a robot of twenty. `FAULTS=1000 mix test test/bb/component/storm_test.exs` makes as many,
  and also measures how long after each fault's end the sensor is up, less the time in which the VM stood still.
  """

  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Robot
  import BB.Test.Watch

  alias BB.Test.{Gaps, Probe, Standstill}

  @moduletag timeout: :infinity

  @siblings for n <- 1..19, do: :"sibling_#{n}"

  # `{name, what is scripted, how it is set off}`. A fault ends when its script does; one that strikes once has ended when it strikes.
  defp faults do
    [
      {"init raises", [init: fn _ -> raise "broken" end], &kill/1},
      {"init throws", [init: fn _ -> throw(:ball) end], &kill/1},
      {"init exits", [init: fn _ -> exit(:broken) end], &kill/1},
      {"init returns nonsense", [init: fn _ -> :nonsense end], &kill/1},
      {"init returns {:stop, reason}", [init: fn _ -> {:stop, :absent} end], &kill/1},
      {"init returns {:error, reason}", [init: fn _ -> {:error, :enodev} end], &kill/1},
      {"init is killed", [init: fn _ -> Process.exit(self(), :kill) end], &kill/1},
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
           spawn_link(fn -> exit(:broken) end) && Process.sleep(:infinity)
         end
       ], &cast/1},
      {"killed", [], &kill/1},
      {"hangs, and is killed", [handle_cast: fn _, _ -> Process.sleep(:infinity) end],
       fn robot ->
         cast(robot)
         kill(robot)
       end}
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

  test "injected faults on one sensor of a robot of twenty: no sibling misses a sample or changes its pid, the robot's supervisors never restart, and the faulty one is up within 1 s of the fault's end" do
    robot = twenty()
    start_supervised!(robot)
    assert eventually(fn -> Enum.all?(BB.Sensor.health(robot), &(&1.state == :up)) end)
    {:ok, _} = BB.subscribe(robot, [:sensor_status])
    {:ok, gaps} = Gaps.start_link(robot)
    {:ok, standstill} = Standstill.start_link()
    supervisors = supervisors(robot)
    siblings = for name <- @siblings, do: pid(robot, name)
    healing = Map.new(faults(), fn {_name, script, _} -> {script, heal(script)} end)

    slowest_ms =
      faults()
      |> Stream.cycle()
      |> Enum.take(count())
      |> Enum.map(fn fault -> strike(robot, fault, healing, standstill) end)
      |> Enum.max()

    assert {heard, []} = Gaps.report(gaps)
    assert map_size(heard) == 19
    assert for(name <- @siblings, do: pid(robot, name)) == siblings
    assert supervisors(robot) == supervisors
    assert health(robot, :imu).restarts >= count()
    assert for(%{state: state} <- BB.Sensor.health(robot), do: state) == List.duplicate(:up, 20)

    if System.get_env("FAULTS") do
      IO.puts("\n#{count()} faults; the slowest recovery took #{slowest_ms} ms")
      assert slowest_ms <= 1_000
    end
  end

  defp count, do: String.to_integer(System.get_env("FAULTS") || "#{length(faults())}")

  # Returns after how many milliseconds from the fault's end on the sensor was up.
  defp strike(robot, {_name, script, set_off}, healing, standstill) do
    before = pid(robot, :imu)
    Probe.script(robot, :imu, script)
    set_off.(robot)
    assert_status(robot, :imu, %{state: :backoff, retry_in_ms: retry_ms})
    assert retry_ms <= 750
    Probe.script(robot, :imu, healing[script])
    _before = Standstill.take(standstill)
    ended_ms = System.monotonic_time(:millisecond)
    await_up(robot)
    assert pid(robot, :imu) not in [before, :undefined]
    System.monotonic_time(:millisecond) - ended_ms - Standstill.take(standstill)
  end

  # A fault of init may have struck once more, for another reason.
  defp await_up(robot) do
    receive do
      {:bb, [:sensor_status | _], %{robot: ^robot, payload: %{state: :up}}} ->
        :ok

      {:bb, [:sensor_status | _], %{payload: %{retry_in_ms: ms}}} when ms <= 750 ->
        await_up(robot)
    after
      30_000 -> flunk("it is not up again: #{inspect(health(robot, :imu))}")
    end

    if health(robot, :imu).state != :up, do: await_up(robot)
  end

  # The callbacks of a sensor that has no fault.
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

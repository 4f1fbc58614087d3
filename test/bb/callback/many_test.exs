defmodule BB.Callback.ManyTest do
  @moduledoc "A failure in many sensors, or many times, costs as much as one."
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Neighbourhood
  import BB.Test.Robot, only: [health: 2]
  import ExUnit.CaptureLog

  alias BB.Test.{Brake, Mischief, Probe}
  alias BB.Test.Mischief.{Mute, Shy}

  defp hurt, do: throw(:mischief)

  describe "many at once" do
    test "whose rate and explain hang are asked at once, and not at each look" do
      drivers = for n <- 1..12, do: {:"rate#{n}", Mischief.driver(:rate, :hang)}
      mutes = for n <- 1..12, do: {:"explain#{n}", Mischief.driver(:explain, :hang)}

      robot =
        declared(
          for {name, module} <- drivers ++ mutes,
              do: quote(do: sensor(unquote(name), unquote(module)))
        )

      root = start(robot)
      neighbour = BB.Process.whereis(robot, :neighbour)
      for _ <- 1..20, do: assert(length(BB.Sensor.health(robot)) == 26)

      assert eventually(
               fn ->
                 robot |> BB.Sensor.health() |> Enum.count(&(&1.error == "{:absent, 1}")) == 12
               end,
               long_ms()
             )

      for {_name, module} <- drivers ++ mutes, do: assert(Mischief.happened(module) < 5)
      goes_on!(robot, neighbour)
      stops!(robot, root)
    end

    test "that hang when the robot stops do not each take their time" do
      # One callback takes five seconds; fifteen in sequence would take more than a minute.
      hung = for n <- 1..15, do: {:"bad#{n}", Mischief.driver(:handle_info, :hang)}

      robot =
        declared(
          for {name, module} <- hung, do: quote(do: sensor(unquote(name), unquote(module)))
        )

      root = start(robot)
      for {name, _} <- hung, do: eventually(fn -> health(robot, name).state == :up end, long_ms())

      for {name, module} <- hung do
        send(BB.Process.whereis(robot, name), :now)
        happens!(module)
      end

      goes_on!(robot, BB.Process.whereis(robot, :neighbour))
      stops!(robot, root)
    end
  end

  describe "what it does wrong" do
    test "is something that cannot be shown: others do not notice, and the log goes on" do
      mute = %Mute{how: &hurt/0}
      shy = %Shy{how: &hurt/0}

      ways = [
        init: fn _opts -> {:stop, mute} end,
        init: fn _opts -> {:stop, {:wrapped, shy}} end,
        init: fn _opts -> {:wrong, shy} end,
        init: fn _opts -> raise mute end,
        handle_cast: fn _, state -> {:stop, shy, state} end,
        handle_cast: fn _, _state -> shy end,
        handle_cast: fn _, _state -> throw(shy) end,
        handle_cast: fn _, _state -> exit({mute, [{__MODULE__, :hang, 0, []}]}) end,
        handle_cast: fn _, _state ->
          spawn_link(fn -> exit({:wrapped, shy}) end)
          hang()
        end
      ]

      for {callback, way} <- ways do
        robot = declared(quote(do: sensor(:bad, BB.Test.Probe)))
        Probe.script(robot, :bad, [{callback, way}])
        root = start(robot)
        neighbour = BB.Process.whereis(robot, :neighbour)
        if callback == :handle_cast, do: up!(robot)
        BB.cast(robot, :bad, :now)
        assert eventually(fn -> health(robot, :bad).error end, long_ms()) =~ "cannot be shown"
        goes_on!(robot, neighbour)
        console_shows!(robot)
        stops!(robot, root)
      end
    end

    test "in a disarm/1 is something that cannot be shown: the robot is disarmed all the same" do
      mute = %Mute{how: &hurt/0}
      shy = %Shy{how: &hurt/0}

      ways = [
        fn _opts -> {:error, shy} end,
        fn _opts -> shy end,
        fn _opts -> throw({:wrapped, shy}) end,
        fn _opts -> exit({mute, [{__MODULE__, :hang, 0, []}]}) end,
        fn _opts -> raise mute end
      ]

      for way <- ways do
        robot = declared([])
        Brake.script(robot, [:base, :brake], disarm: way)
        root = start(robot)
        assert BB.Safety.arm(robot) == :ok
        assert {:error, {:disarm_failed, [{[:base, :brake], _}]}} = BB.Safety.disarm(robot)
        assert BB.Safety.state(robot) == :error
        assert BB.Safety.force_disarm(robot) == :ok
        goes_on!(robot, BB.Process.whereis(robot, :neighbour))
        Supervisor.stop(root)
      end
    end

    defp hang, do: Process.sleep(:infinity)
    defp up!(robot), do: eventually(fn -> health(robot, :bad).state == :up end, long_ms())

    test "is said once, however often a sensor goes down" do
      module = Mischief.driver(:explain, :throw)
      robot = declared(sensor(module))

      log =
        capture_log(fn ->
          root = start(robot)

          for _ <- 1..3 do
            restarts = health(robot, :bad).restarts
            eventually(fn -> health(robot, :bad).restarts > restarts end, long_ms())
            for n <- 1..50, do: BB.Sensor.explain(module, {:absent, n})
          end

          Supervisor.stop(root)
        end)

      said =
        for line <- String.split(log, "\n"), line =~ inspect(module), line =~ "threw", do: line

      assert [line] = said
      assert line =~ "explain/1 threw :mischief; the reason is shown as a term"
    end
  end
end

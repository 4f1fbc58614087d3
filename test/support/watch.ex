defmodule BB.Test.Watch do
  @moduledoc "Starts robots in tests and receives the states of their sensors."

  import BB.Test.Eventually
  import BB.Test.Robot
  import ExUnit.Assertions
  import ExUnit.Callbacks

  alias BB.Test.{Counter, Probe}

  @doc "Makes a robot with a scripted sensor `:imu` between two counters."
  def one_of_three do
    robot do
      sensors do
        sensor :first, BB.Test.Counter
      end

      topology do
        link :base do
          sensor :imu, BB.Test.Probe
          sensor :second, BB.Test.Counter
        end
      end
    end
  end

  @doc "Sets callbacks of the sensor `:imu`."
  def imu(robot, callbacks), do: Probe.script(robot, :imu, callbacks)

  @doc "Returns the process of a sensor."
  def pid(robot, name), do: BB.Process.whereis(robot, name)

  @doc """
  Starts a robot and subscribes to its sensors' states. `replay: true` also delivers the last
  states before that.
  """
  def start_watched(robot, opts \\ []) do
    start_supervised!(robot)
    {:ok, _} = BB.subscribe(robot, [:sensor_status], opts)
    robot
  end

  @doc "Starts a robot in the same way, and waits until a sensor is up."
  def start_up(robot, name \\ :imu) do
    start_watched(robot)
    assert eventually(fn -> health(robot, name).state == :up end)
    robot
  end

  @doc "Receives a matching state of a sensor."
  defmacro assert_status(robot, name, status) do
    quote do
      assert_receive {:bb, [:sensor_status | _],
                      %BB.Message{
                        robot: unquote({:^, [], [robot]}),
                        frame_id: unquote(name),
                        payload: %BB.Message.Sensor.Status{} = unquote(status)
                      }}
    end
  end

  @doc "Returns the description of a sensor's alarm, or `nil` without one."
  def alarm(robot, path) do
    case List.keyfind(:alarm_handler.get_alarms(), {BB.Sensor, robot, path}, 0) do
      nil -> nil
      {_id, description} -> description
    end
  end

  @doc "Receives one count of a `BB.Test.Counter`, and returns the next."
  def first_count(name) do
    assert_receive {:bb, [:sensor | _], %{frame_id: ^name, payload: %Counter.Count{n: n}}}
    n + 1
  end

  @doc "Receives `more` counts without a gap, beginning with `from`, and returns the next."
  def count_on(name, from, more) do
    Enum.each(from..(from + more - 1)//1, fn expected ->
      assert first_count(name) == expected + 1
    end)

    from + more
  end
end

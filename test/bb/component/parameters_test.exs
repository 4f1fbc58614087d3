defmodule BB.Component.ParametersTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Robot
  import BB.Unit, only: :sigils

  alias BB.Options.ValidationError
  alias BB.Parameter
  alias BB.Sensor.SensorProfile

  defmodule Tuned do
    @moduledoc "A sensor that sends each call of a callback to the process registered as `to:`."
    use BB.Sensor,
      options_schema: [
        to: [type: :atom, required: true],
        gain: [type: :float, default: 1.0],
        rate: [type: {:struct, BB.Unit}],
        level: [type: {:in, 1..10}, default: 1]
      ]

    @impl BB.Sensor
    def init(opts), do: tell(opts[:to], {:init, self(), opts}, {:ok, opts})

    @impl BB.Sensor
    def handle_options(opts, old) do
      tell(opts[:to], {:options, opts}, :ok)

      case opts[:gain] do
        13.0 -> {:stop, :unlucky}
        14.0 -> raise "#{old[:gain]} was better"
        _ -> {:ok, opts}
      end
    end

    @impl BB.Sensor
    def handle_call(:subscribe, _from, opts) do
      {:ok, _} = BB.subscribe(opts[:bb].robot, [:param, :gain])
      {:reply, :ok, opts}
    end

    def handle_call({:wait, ms}, _from, opts), do: {:reply, :ok, opts, ms}

    @impl BB.Sensor
    def handle_info(message, opts), do: tell(opts[:to], {:info, message}, {:noreply, opts})

    @impl BB.Sensor
    def terminate(reason, opts), do: tell(opts[:to], {:terminated, reason}, :ok)

    defp tell(to, what, result) do
      if pid = Process.whereis(to), do: send(pid, what)
      result
    end
  end

  setup do
    me = :"#{__MODULE__}.#{System.unique_integer([:positive])}"
    Process.register(self(), me)

    robot =
      create(
        quote do
          parameters do
            param :gain, type: :float, default: 0.5
            param :level, type: :integer, default: 2
            param :other, type: :integer, default: 0

            group :gear do
              param :ratio, type: :float, default: 2.0
              param :zero, type: {:unit, :degree}, default: ~u(90 degree)
              param :reversed, type: :boolean, default: false
            end

            param :top, type: {:unit, :degree}, default: ~u(90 degree)
          end

          topology do
            link :base do
              sensor :tuned,
                     {BB.Component.ParametersTest.Tuned,
                      to: unquote(me), gain: param([:gain]), level: param([:level])}

              joint :elbow do
                type :revolute

                limit lower: ~u(0 degree),
                      upper: param([:top]),
                      effort: ~u(1 newton_meter),
                      velocity: ~u(1 radian_per_second)

                sensor :encoder, {BB.Component.ParametersTest.Tuned, to: unquote(me)} do
                  transmission do
                    reduction param([:gear, :ratio])
                    offset param([:gear, :zero])
                    reversed? param([:gear, :reversed])
                  end
                end

                link :arm
              end
            end
          end
        end
      )

    %{robot: robot, me: me}
  end

  defp start(robot, opts \\ []) do
    start_supervised!({robot, opts})
    pids = for _ <- 1..2, into: %{}, do: heard()
    {pids.tuned, pids.encoder}
  end

  defp heard do
    assert_receive {:init, pid, opts}
    {List.last(opts[:bb].path), pid}
  end

  describe "a reference param([:a, :b])" do
    test "is resolved before init", %{robot: robot} do
      start_supervised!(robot)
      assert_receive {:init, _, [{:bb, %{path: [:base, :tuned]}} | _] = opts}
      assert opts[:gain] == 0.5
      assert opts[:level] == 2
    end

    test "is checked at the robot's start, which fails for a value that the component refuses",
         %{
           robot: robot
         } do
      assert {:error, %ValidationError{} = error} = robot.start_link(params: [level: 11])

      assert Exception.message(error) ==
               "invalid value for :level option: expected one of 1..10, got: 11 (in options [:base, :tuned])"
    end

    test "may be a limit's field, into which BB.Robot.resolve puts the current value", %{
      robot: robot
    } do
      start(robot)
      assert %{lower: lower, upper: nil} = robot.robot().joints.elbow.limits
      assert lower == 0.0
      :ok = Parameter.set(robot, [:top], ~u(45 degree))
      resolved = BB.Robot.resolve(robot.robot(), &Parameter.get!(robot, &1))
      assert_in_delta resolved.joints.elbow.limits.upper, :math.pi() / 4, 1.0e-12
    end
  end

  describe "a changed parameter" do
    test "calls handle_options once, with all options", %{robot: robot} do
      {pid, _} = start(robot)
      :ok = Parameter.set(robot, [:gain], 0.75)
      assert_receive {:options, opts}
      assert Keyword.keys(opts) |> Enum.sort() == [:bb, :gain, :level, :sensor_profile, :to]
      assert {opts[:gain], opts[:level]} == {0.75, 2}
      assert opts[:bb] == %{robot: robot, path: [:base, :tuned]}
      settle(robot)
      refute_received {:options, _}
      assert BB.Process.whereis(robot, :tuned) == pid
      assert :sys.get_state(pid).user_state[:gain] == 0.75
    end

    test "calls it once for each change, in order", %{robot: robot} do
      start(robot)
      for n <- 1..20, do: :ok = Parameter.set(robot, [:gain], n / 100)

      for n <- 1..20 do
        gain = n / 100
        assert_receive {:options, opts}
        assert opts[:gain] == gain
      end

      settle(robot)
      refute_received {:options, _}
    end

    test "calls it once when set_many changes two parameters of one component", %{robot: robot} do
      start(robot)
      :ok = Parameter.set_many(robot, [{[:gain], 0.1}, {[:level], 3}, {[:other], 1}])
      assert_receive {:options, opts}
      assert {opts[:gain], opts[:level]} == {0.1, 3}
      settle(robot)
      refute_received {:options, _}
    end

    test "calls nothing when its value is the same, or without a reference", %{robot: robot} do
      start(robot)
      :ok = Parameter.set(robot, [:gain], 0.5)
      :ok = Parameter.set(robot, [:other], 1)
      settle(robot)
      refute_received {:options, _}
    end

    test "never reaches the user's handle_info", %{robot: robot} do
      start(robot)
      :ok = Parameter.set(robot, [:gain], 0.75)
      assert_receive {:options, _}
      settle(robot)
      refute_received {:info, _}
    end

    test "reaches handle_info once by the user's own subscription", %{robot: robot} do
      start(robot)
      :ok = BB.call(robot, :tuned, :subscribe)
      :ok = Parameter.set(robot, [:gain], 0.75)
      assert_receive {:info, {:bb, [:param, :gain], %{payload: %Parameter.Changed{}}}}
      assert_receive {:options, _}
      settle(robot)
      refute_received {:info, _}
      refute_received {:options, _}
    end

    test "does not end the user's time-out", %{robot: robot} do
      start(robot)
      :ok = BB.call(robot, :tuned, {:wait, 100})
      :ok = Parameter.set(robot, [:gain], 0.75)
      assert_receive {:options, _}
      assert_receive {:info, :timeout}
    end

    # Each component has handled all messages from before this call.
    defp settle(robot),
      do: for(name <- [:tuned, :encoder], do: BB.call(robot, name, {:wait, :infinity}))
  end

  describe "the process stops" do
    test "when handle_options returns {:stop, reason}", %{robot: robot} do
      {pid, _} = start(robot)
      ref = Process.monitor(pid)
      :ok = Parameter.set(robot, [:gain], 13.0)
      assert_receive {:DOWN, ^ref, _, _, :unlucky}
      assert_received {:terminated, :unlucky}
      assert {:tuned, _pid} = heard()
      assert eventually(fn -> health(robot, :tuned).state == :up end)
    end

    test "when the options become invalid, and is up again when they are right", %{
      robot: robot
    } do
      {pid, _} = start(robot)
      ref = Process.monitor(pid)
      :ok = Parameter.set(robot, [:level], 11)
      assert_receive {:DOWN, ^ref, _, _, %ValidationError{} = error}

      message =
        "invalid value for :level option: expected one of 1..10, got: 11 (in options [:base, :tuned])"

      assert Exception.message(error) == message
      refute_received {:options, _}

      assert eventually(fn ->
               match?(%{state: :backoff, reason: %ValidationError{}}, health(robot, :tuned))
             end)

      assert BB.Sensor.explain(Tuned, health(robot, :tuned).reason) == message
      :ok = Parameter.set(robot, [:level], 10)
      assert_receive {:init, _pid, opts}
      assert opts[:level] == 10
    end

    test "when handle_options crashes, and is up again with the new value", %{robot: robot} do
      {pid, _} = start(robot)
      ref = Process.monitor(pid)
      :ok = Parameter.set(robot, [:gain], 14.0)
      assert_receive {:DOWN, ^ref, _, _, _}
      assert_receive {:init, _pid, opts}
      assert opts[:gain] == 14.0
    end
  end

  test "no change is missed between a component's start and its init, and none comes twice", %{
    robot: robot
  } do
    {pid, _} = start(robot)
    test = self()

    writer =
      spawn_link(fn ->
        for n <- 1..300, do: :ok = Parameter.set(robot, [:gain], n / 1000)
        send(test, :written)
      end)

    Process.exit(pid, :kill)
    assert is_pid(writer)
    assert_receive :written
    assert {:tuned, _} = started_again()
    settle(robot)
    {:ok, last} = Parameter.get(robot, [:gain])

    # The values since the last init grow without a gap or a repetition, up to the current one.
    gains = since_init([])
    assert gains == Enum.map(round(hd(gains) * 1000)..round(last * 1000)//1, &(&1 / 1000))
  end

  defp started_again do
    if eventually(fn -> Enum.any?(messages(), &match?({:init, _, _}, &1)) end), do: {:tuned, nil}
  end

  defp messages, do: self() |> Process.info(:messages) |> elem(1)

  defp since_init(gains) do
    receive do
      {:init, _, opts} -> since_init([opts[:gain]])
      {:options, opts} -> since_init([opts[:gain] | gains])
    after
      0 -> Enum.reverse(gains)
    end
  end

  test "components are up again when the robot's parameters restart", %{robot: robot} do
    {pid, _} = start(robot)
    ref = Process.monitor(pid)
    Process.exit(Process.whereis(Module.concat(robot, Parameters)), :kill)
    assert_receive {:DOWN, ^ref, _, _, _}
    assert [:encoder, :tuned] = Enum.sort(for _ <- 1..2, do: elem(heard(), 0))
    :ok = Parameter.set(robot, [:gain], 0.9)
    assert_receive {:options, opts}
    assert opts[:gain] == 0.9
  end

  test "a killed runtime restarts neither root nor topology, and all components are up again",
       %{robot: robot} do
    {pid, _} = start(robot)
    supervisors = supervisors(robot)
    {:runtime, runtime, _, _} = robot |> Supervisor.which_children() |> List.keyfind(:runtime, 0)
    ref = Process.monitor(pid)
    Process.exit(runtime, :kill)
    assert_receive {:DOWN, ^ref, _, _, _}
    assert [:encoder, :tuned] = Enum.sort(for _ <- 1..2, do: elem(heard(), 0))
    assert Parameter.get(robot, [:gain]) == {:ok, 0.5}
    assert supervisors(robot) == supervisors
  end

  describe "a transmission" do
    test "is in opts[:sensor_profile], with values in SI units", %{robot: robot} do
      start_supervised!(robot)
      assert_receive {:init, _, [{:bb, %{path: [:base, :elbow, :encoder]}} | _] = opts}

      assert opts[:sensor_profile] == %SensorProfile{
               joint_name: :elbow,
               transmission: %{reduction: 2.0, offset: :math.pi() / 2, reversed?: false}
             }
    end

    test "follows its parameters at run time", %{robot: robot} do
      start(robot)
      :ok = Parameter.set(robot, [:gear, :ratio], 4.0)
      assert_receive {:options, opts}
      assert opts[:sensor_profile].transmission.reduction == 4.0

      :ok =
        Parameter.set_many(robot, [{[:gear, :zero], ~u(0 degree)}, {[:gear, :reversed], true}])

      assert_receive {:options, opts}
      assert opts[:sensor_profile].transmission == %{reduction: 4.0, offset: 0.0, reversed?: true}
      settle(robot)
      refute_received {:options, _}
    end

    test "that has become invalid stops the process", %{robot: robot} do
      {_, pid} = start(robot)
      ref = Process.monitor(pid)
      :ok = Parameter.set(robot, [:gear, :ratio], 0.0)
      assert_receive {:DOWN, ^ref, _, _, %ValidationError{} = error}

      assert Exception.message(error) ==
               "invalid value for :reduction option: expected a number other than zero, got: 0.0 (in options [:base, :elbow, :encoder, :transmission])"
    end

    test "is applied by to_joint_space and publish_joint_state at its current values", %{
      robot: robot
    } do
      start(robot)
      {:ok, _} = BB.subscribe(robot, [:sensor])
      path = [:base, :elbow, :encoder]
      :ok = BB.Sensor.publish_joint_state(robot, path, positions: [1.0], velocities: [3.0])
      offset = :math.pi() / 2

      assert_receive {:bb, [:sensor | ^path], %{frame_id: :elbow, payload: state}}
      assert %{names: [:elbow], velocities: [1.5], positions: [position]} = state
      assert_in_delta position, 0.5 + offset, 1.0e-12

      :ok =
        Parameter.set_many(robot, [{[:gear, :zero], ~u(0 degree)}, {[:gear, :reversed], true}])

      message = BB.Message.new!(BB.Message.Sensor.JointState, :x, names: [:x], positions: [1.0])
      assert BB.Sensor.to_joint_space(robot, path, message).payload.positions == [-0.5]
    end

    test "that is not declared leaves the message of to_joint_space unchanged", %{robot: robot} do
      message = BB.Message.new!(BB.Message.Sensor.JointState, :x, names: [:x], positions: [1.0])
      assert BB.Sensor.to_joint_space(robot, [:base, :tuned], message) == message
      assert BB.Sensor.to_joint_space(SomeModule, [:x], message) == message
    end
  end

  test "BB.Sensor.Server without a keeper follows parameters too", %{robot: robot, me: me} do
    start(robot)
    Process.flag(:trap_exit, true)
    reference = %BB.Parameter.Reference{path: [:gain]}

    args = [
      __callback_module__: Tuned,
      bb: %{robot: robot, path: [:base, :extra]},
      to: me,
      gain: reference
    ]

    {:ok, pid} = BB.Sensor.Server.start_link(args)
    assert_receive {:init, ^pid, opts}
    assert opts[:gain] == 0.5
    :ok = Parameter.set(robot, [:gain], 13.0)
    assert_receive {:EXIT, ^pid, :unlucky}

    assert BB.Sensor.Server.start_link(
             Keyword.put(args, :gain, %BB.Parameter.Reference{path: [:no]})
           ) ==
             {:error, {:unregistered_parameter, [:no]}}
  end
end

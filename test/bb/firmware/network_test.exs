defmodule BB.Firmware.NetworkTest do
  use ExUnit.Case, async: true

  import BB.Test.Robot

  alias BB.Firmware.Network
  alias BB.Message.Network.Connection
  alias BB.Safety
  alias BB.StateMachine.Transition

  setup do
    robot =
      robot do
        topology do
          link :base_link do
          end
        end
      end

    %{robot: robot, source: start_supervised!({BB.Test.Network, :lan})}
  end

  defp network(context, opts \\ []) do
    defaults = [
      robot: context.robot,
      name: nil,
      adapter: {BB.Test.Network, context.source},
      period_ms: 60_000
    ]

    start_supervised!({Network, Keyword.merge(defaults, opts)})
  end

  test "the connection is published when it is known, and at each change", context do
    start_supervised!(context.robot)
    {:ok, _} = BB.subscribe(context.robot, [:sensor])
    network(context)

    assert_receive {:bb, [:sensor, :network], %{payload: %Connection{state: :lan}}}
    BB.Test.Network.set(context.source, :internet)
    assert_receive {:bb, [:sensor, :network], %{payload: %Connection{state: :internet}}}
    BB.Test.Network.set(context.source, :disconnected)
    assert_receive {:bb, [:sensor, :network], %{payload: %Connection{state: :disconnected}}}
  end

  defmodule Late do
    # As VintageNet, whose table is not there before its application is.
    def subscribe(flag), do: if(Agent.get(flag, & &1), do: :ok, else: raise(ArgumentError))
    def state(flag), do: if(Agent.get(flag, & &1), do: :internet, else: exit(:noproc))
    def change(_flag, _message), do: :error
  end

  test "a source that is not there yet is found once it is", context do
    flag = start_supervised!({Agent, fn -> false end})
    start_supervised!(context.robot)
    {:ok, _} = BB.subscribe(context.robot, [:sensor, :network])
    network(context, adapter: {Late, flag}, period_ms: 20)
    assert_receive {:bb, _, %{payload: %Connection{state: :unknown}}}, 30_000
    Agent.update(flag, fn _ -> true end)
    assert_receive {:bb, _, %{payload: %Connection{state: :internet}}}, 30_000
  end

  test "the connection is published each period", context do
    start_supervised!(context.robot)
    {:ok, _} = BB.subscribe(context.robot, [:sensor, :network])
    network(context, period_ms: 5)
    for _ <- 1..3, do: assert_receive({:bb, [:sensor, :network], _})
  end

  test "who comes late gets the last connection", context do
    start_supervised!(context.robot)
    {:ok, _} = BB.subscribe(context.robot, [:sensor, :network])
    network(context)
    assert_receive {:bb, [:sensor, :network], _}

    assert %{payload: %Connection{state: :lan}} =
             BB.PubSub.last(context.robot, [:sensor, :network])
  end

  test "a robot that starts later, or again, is told", context do
    network(context)

    for _ <- 1..2 do
      start_supervised!(context.robot)
      {:ok, _} = BB.subscribe(context.robot, [:sensor, :network], replay: true)
      assert_receive {:bb, [:sensor, :network], %{payload: %Connection{state: :lan}}}
      stop_supervised!(context.robot)
    end
  end

  test "a lost connection changes nothing for an armed robot", context do
    start_supervised!(context.robot)
    {:ok, _} = BB.subscribe(context.robot, [:sensor])
    network(context)
    :ok = Safety.arm(context.robot)
    BB.Test.Network.set(context.source, :disconnected)
    assert_receive {:bb, [:sensor, :network], %{payload: %Connection{state: :disconnected}}}
    assert Safety.armed?(context.robot)
  end

  test "a robot that needs an operator is disarmed without one", context do
    start_supervised!(context.robot)
    network(context, disarm_after_ms: 40)
    {:ok, _} = BB.subscribe(context.robot, [:state_machine])
    :ok = Safety.arm(context.robot)
    assert_receive {:bb, [:state_machine], %{payload: %Transition{to: :armed}}}
    assert_receive {:bb, [:state_machine], %{payload: %Transition{to: :disarmed}}}
  end

  test "a robot that hears its operator stays armed", context do
    start_supervised!(context.robot)
    {:ok, _} = BB.subscribe(context.robot, [:operator])
    {:ok, _} = BB.subscribe(context.robot, [:state_machine])
    network = network(context, disarm_after_ms: 5_000)
    # It has subscribed once it answers.
    _ = :sys.get_state(network)
    :ok = Safety.arm(context.robot)
    for _ <- 1..20, do: :ok = Network.sign(context.robot, "ada")
    assert_receive {:bb, [:operator], %{payload: %BB.Message.Network.Operator{name: "ada"}}}
    _ = :sys.get_state(network)
    assert Safety.armed?(context.robot)
    refute_received {:bb, [:state_machine], %{payload: %Transition{to: :disarming}}}
  end

  test "without a network of its own the robot is told that it is unknown", context do
    start_supervised!(context.robot)
    {:ok, _} = BB.subscribe(context.robot, [:sensor, :network])
    network(context, adapter: {Network.None, []})
    assert_receive {:bb, [:sensor, :network], %{payload: %Connection{state: :unknown}}}
  end
end

defmodule BB.PubSubTest do
  use ExUnit.Case, async: true

  alias BB.{Message, PubSub}
  alias BB.Message.Sensor.{PowerState, Range, Status}

  doctest BB.PubSub

  defmodule Recorder do
    @moduledoc "A process that records the messages it gets, and runs functions."
    use GenServer

    def start, do: GenServer.start(__MODULE__, [])
    def recorded(pid), do: GenServer.call(pid, :recorded)
    def run(pid, fun), do: GenServer.call(pid, {:run, fun})

    @impl GenServer
    def init(received), do: {:ok, received}

    @impl GenServer
    def handle_info(message, received), do: {:noreply, [message | received]}

    @impl GenServer
    def handle_call(:recorded, _from, received), do: {:reply, Enum.reverse(received), received}
    def handle_call({:run, fun}, _from, received), do: {:reply, fun.(), received}
  end

  setup do
    robot = Module.concat(__MODULE__, "Robot#{System.unique_integer([:positive])}")
    start_supervised!({PubSub, robot})
    %{robot: robot}
  end

  defp status(restarts \\ 0), do: Message.new!(Status, :frame, state: :up, restarts: restarts)
  defp power, do: Message.new!(PowerState, :frame, voltage: 1.0, current: 0.0)

  # A process that subscribes and forwards its messages, tagged, until it gets :stop.
  defp subscriber(robot, path, opts \\ []) do
    test = self()

    pid =
      spawn_link(fn ->
        {:ok, _} = PubSub.subscribe(robot, path, opts)
        send(test, {:subscribed, self()})
        forward(test)
      end)

    assert_receive {:subscribed, ^pid}
    pid
  end

  defp forward(test) do
    receive do
      {:bb, _, _} = delivery ->
        send(test, {self(), delivery})
        forward(test)

      :stop ->
        :ok
    end
  end

  # Returns the processes to which this one sends while `fun` runs, in order.
  defp sends(fun) do
    {:ok, tracer} = GenServer.start_link(Recorder, [])
    :erlang.trace(self(), true, [:send, {:tracer, tracer}])
    fun.()
    :erlang.trace(self(), false, [:send])
    ref = :erlang.trace_delivered(self())
    assert_receive {:trace_delivered, _, ^ref}
    for {:trace, _, :send, {:bb, _, _}, to} <- Recorder.recorded(tracer), do: to
  end

  describe "subscribe" do
    test "subscribes the caller and returns {:ok, pid}", %{robot: robot} do
      assert {:ok, pid} = PubSub.subscribe(robot, [:sensor])
      assert is_pid(pid)
      assert PubSub.subscribers(robot, [:sensor]) == [{self(), []}]
    end

    test "message_types is a list of payload modules, [] is all", %{robot: robot} do
      PubSub.subscribe(robot, [:a], message_types: [Status])
      PubSub.subscribe(robot, [:b], message_types: [])

      for path <- [[:a], [:b]],
          message <- [status(), power()],
          do: PubSub.publish(robot, path, message)

      assert_received {:bb, [:a], %{payload: %Status{}}}
      assert_received {:bb, [:b], %{payload: %Status{}}}
      assert_received {:bb, [:b], %{payload: %PowerState{}}}
      refute_received {:bb, [:a], %{payload: %PowerState{}}}
    end

    test "an unknown option raises and names those that are accepted", %{robot: robot} do
      assert_raise ArgumentError,
                   "unknown options [:types], valid options are: [:message_types, :max_rate, :replay, :exact, :unique, :max_queue]",
                   fn ->
                     PubSub.subscribe(robot, [:a], types: [])
                   end
    end

    test "message types that are no modules raise", %{robot: robot} do
      for types <- [Status, ["Status"]] do
        assert_raise ArgumentError,
                     ~r/^invalid (value for :message_types option: expected list|list in :message_types option: .* expected module), got: /,
                     fn ->
                       PubSub.subscribe(robot, [:a], message_types: types)
                     end
      end
    end
  end

  describe "unsubscribe" do
    test "removes all of the caller's subscriptions at exactly that path", %{robot: robot} do
      for path <- [[:a], [:a], [:a, :b], []], do: PubSub.subscribe(robot, path)
      other = subscriber(robot, [:a])
      assert PubSub.unsubscribe(robot, [:a]) == :ok

      assert PubSub.subscribers(robot, [:a]) == [{other, []}]
      assert [_] = PubSub.subscribers(robot, [:a, :b])
      assert [_] = PubSub.subscribers(robot, [])
    end

    test "is :ok when there is none", %{robot: robot} do
      assert PubSub.unsubscribe(robot, [:a]) == :ok
      assert PubSub.unsubscribe(NotStarted, [:a]) == :ok

      # The bus ends after it was looked up.
      {:ok, bus} = BB.PubSub.Bus.fetch(robot)
      :ok = stop_supervised({PubSub, robot})
      assert BB.PubSub.Registrar.unsubscribe(bus, self(), [:a]) == :ok
    end
  end

  describe "publish" do
    test "is :ok with nobody listening", %{robot: robot} do
      assert PubSub.publish(robot, [:a, :b], status()) == :ok
    end

    test "delivers {:bb, path, message} with the robot in the message", %{robot: robot} do
      PubSub.subscribe(robot, [:sensor])
      message = status()
      assert PubSub.publish(robot, [:sensor, :link, :imu], message) == :ok
      expected = %{message | robot: robot}
      assert_received {:bb, [:sensor, :link, :imu], ^expected}
    end

    test "delivers at the exact path, then each ancestor, last []", %{robot: robot} do
      levels = [[], [:a, :b, :c], [:a], [:a, :b]]
      at = Map.new(levels, &{subscriber(robot, &1), &1})

      receivers = sends(fn -> PubSub.publish(robot, [:a, :b, :c], status()) end)
      assert Enum.map(receivers, &at[&1]) == [[:a, :b, :c], [:a, :b], [:a], []]
    end

    test "reaches a subscriber at the root", %{robot: robot} do
      PubSub.subscribe(robot, [])
      PubSub.publish(robot, [:a, :b], status())
      PubSub.publish(robot, [], status())
      assert_received {:bb, [:a, :b], _}
      assert_received {:bb, [], _}
    end

    test "does not reach siblings, cousins or children", %{robot: robot} do
      for path <- [[:a, :c], [:b], [:a, :b, :c], [:b, :a]], do: PubSub.subscribe(robot, path)
      PubSub.publish(robot, [:a, :b], status())
      refute_received {:bb, _, _}
    end

    test "filters on the payload's struct", %{robot: robot} do
      PubSub.subscribe(robot, [:a], message_types: [Range, PowerState])
      PubSub.publish(robot, [:a], status())
      PubSub.publish(robot, [:a], power())
      assert_received {:bb, _, %{payload: %PowerState{}}}
      refute_received {:bb, _, _}
    end

    test "except skips processes", %{robot: robot} do
      PubSub.subscribe(robot, [:a])
      other = subscriber(robot, [:a])
      PubSub.publish(robot, [:a], status(), except: [self()])
      assert_receive {^other, {:bb, [:a], _}}
      refute_received {:bb, [:a], _}
    end

    test "except takes :undefined for a process that is down", %{robot: robot} do
      PubSub.subscribe(robot, [:a])
      other = subscriber(robot, [:a])
      assert PubSub.publish(robot, [:a], status(), except: [:undefined, self()]) == :ok
      assert_receive {^other, {:bb, [:a], _}}
      refute_received {:bb, [:a], _}
      assert PubSub.publish(robot, [:a], status(), except: [:undefined]) == :ok
      assert_received {:bb, [:a], _}

      assert_raise ArgumentError, ~r/^invalid .*:except option/s, fn ->
        PubSub.publish(robot, [:a], status(), except: [:nobody])
      end
    end

    test "an unknown option raises and names the one that is accepted", %{robot: robot} do
      assert_raise ArgumentError,
                   ~r/^unknown options \[:only\], valid options are: \[:except\]$/,
                   fn ->
                     PubSub.publish(robot, [:a], status(), only: [])
                   end

      assert_raise ArgumentError,
                   ~r/^invalid value for :except option: expected list, got: #PID/,
                   fn ->
                     PubSub.publish(robot, [:a], status(), except: self())
                   end
    end

    test "what is no message raises", %{robot: robot} do
      assert_raise ArgumentError,
                   ~r/^expected a %BB.Message{}, got: :hello; create one with/,
                   fn ->
                     PubSub.publish(robot, [:a], :hello)
                   end
    end
  end

  describe "paths" do
    test "a reference is allowed as an element", %{robot: robot} do
      path = [:reply, make_ref()]
      PubSub.subscribe(robot, path)
      PubSub.publish(robot, path, status())
      assert_received {:bb, ^path, _}
    end

    test "anything else raises", %{robot: robot} do
      for path <- [["sensor"], :sensor, [:a | :b]] do
        assert_raise ArgumentError, ~r/expected a path, a list of atoms/, fn ->
          PubSub.publish(robot, path, status())
        end

        assert_raise ArgumentError, ~r/expected a path, a list of atoms/, fn ->
          PubSub.subscribe(robot, path)
        end

        assert_raise ArgumentError, ~r/expected a path, a list of atoms/, fn ->
          PubSub.unsubscribe(robot, path)
        end

        assert_raise ArgumentError, ~r/expected a path, a list of atoms/, fn ->
          PubSub.subscribers(robot, path)
        end
      end
    end

    test "ancestor_paths are longest first and end in []" do
      assert PubSub.ancestor_paths([:a, :b]) == [[:a, :b], [:a], []]
      assert PubSub.ancestor_paths([]) == [[]]
    end
  end

  describe "order" do
    test "holds per publisher and subscriber, at whatever paths", %{robot: robot} do
      PubSub.subscribe(robot, [:a])

      publishers =
        for publisher <- 1..4 do
          Task.async(fn ->
            for n <- 1..200,
                do:
                  PubSub.publish(
                    robot,
                    Enum.at([[:a], [:a, :b]], rem(n, 2)),
                    status(publisher * 1000 + n)
                  )
          end)
        end

      Task.await_many(publishers, :infinity)

      received =
        for _ <- 1..800 do
          assert_received {:bb, _, message}
          message.payload.restarts
        end

      for {_publisher, numbers} <- Enum.group_by(received, &div(&1, 1000)) do
        assert length(numbers) == 200
        assert numbers == Enum.sort(numbers)
      end
    end

    test "a process subscribed twice, or at two levels, receives twice", %{robot: robot} do
      for path <- [[:a], [:a], []], do: PubSub.subscribe(robot, path)
      PubSub.publish(robot, [:a], status())
      for _ <- 1..3, do: assert_received({:bb, [:a], _})
      refute_received {:bb, _, _}
    end
  end

  describe "a robot that is not started" do
    test "publish, subscribe and subscribers raise ArgumentError" do
      for call <- [
            fn -> PubSub.publish(NotStarted, [:a], status()) end,
            fn -> PubSub.subscribe(NotStarted, [:a]) end,
            fn -> PubSub.subscribers(NotStarted, [:a]) end
          ] do
        assert_raise ArgumentError,
                     ~r/^robot NotStarted is not started; start it .* NotStarted.start_link\(\)$/,
                     call
      end
    end
  end

  describe "subscribers" do
    test "are [{pid, message_types}] at that exact path", %{robot: robot} do
      other = subscriber(robot, [:a], message_types: [Status])
      subscriber(robot, [:a, :b])
      PubSub.subscribe(robot, [:a])

      assert Enum.sort(PubSub.subscribers(robot, [:a])) ==
               Enum.sort([{other, [Status]}, {self(), []}])

      assert PubSub.subscribers(robot, []) == []
    end

    test "that are dead vanish", %{robot: robot} do
      pid = subscriber(robot, [:a])
      monitor = Process.monitor(pid)
      send(pid, :stop)
      assert_receive {:DOWN, ^monitor, _, _, _}
      assert PubSub.subscribers(robot, [:a]) == []
      assert PubSub.publish(robot, [:a], status()) == :ok
    end
  end

  test "there is no bus process: publishing runs in the publisher", %{robot: robot} do
    PubSub.subscribe(robot, [:a])
    {:ok, bus} = PubSub.subscribe(robot, [:b])
    :sys.suspend(bus)
    PubSub.publish(robot, [:a], status())
    assert_received {:bb, [:a], _}
    :sys.resume(bus)
  end

  test "there is no per-message telemetry event on the publish path", %{robot: robot} do
    {:ok, _} = PubSub.subscribe(robot, [:sensor], max_rate: 1_000)
    {:ok, _} = PubSub.subscribe(robot, [:param], replay: true)
    test = self()
    {:module, _} = Code.ensure_loaded(BB.Telemetry)
    1 = :erlang.trace_pattern({BB.Telemetry, :emit, 3}, true, [:local])

    publisher =
      spawn_link(fn ->
        receive do: (:go -> :ok)

        for path <- [[:sensor, :a], [:param, :b], [:nobody]],
            do: PubSub.publish(robot, path, status())

        send(test, :published)
        receive do: (:emit -> BB.Telemetry.emit([:bb, :test, :seen], %{}, %{}))
      end)

    :erlang.trace(publisher, true, [:call])
    send(publisher, :go)
    assert_receive :published
    ref = :erlang.trace_delivered(publisher)
    assert_receive {:trace_delivered, ^publisher, ^ref}
    refute_received {:trace, _, :call, _}
    assert_received {:bb, [:sensor, :a], _}

    # The trace does show such an event.
    send(publisher, :emit)

    assert_receive {:trace, ^publisher, :call, {BB.Telemetry, :emit, [[:bb, :test, :seen] | _]}}
  end

  test "two robots do not hear each other", %{robot: robot} do
    other = Module.concat(robot, Other)
    start_supervised!({PubSub, other})
    PubSub.subscribe(robot, [:a])
    PubSub.publish(other, [:a], status())
    refute_received {:bb, _, _}
  end
end

defmodule BB.EstimatorTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually

  alias BB.Estimator.Context
  alias BB.Message
  alias BB.Message.Sensor.Contact
  alias BB.Robot.Runtime

  defmodule Probe do
    use BB.Sensor

    @impl BB.Sensor
    def init(opts), do: {:ok, opts}
  end

  # Publishes what it is given, and does what messages say. The owner is a registered process.
  defmodule Echo do
    use BB.Estimator, options_schema: [owner: [type: :atom], gain: [type: :integer, default: 1]]

    @impl BB.Estimator
    def init(opts) do
      state = Map.new(opts) |> Map.merge(%{given: [], slow_ms: 0})
      tell(state, {:init, self(), opts})
      {:ok, state}
    end

    @impl BB.Estimator
    def handle_input(input, state) do
      Process.sleep(state.slow_ms)
      tell(state, {:input, input})
      {:reply, [out: output(true)], %{state | given: [input | state.given]}}
    end

    @impl BB.Estimator
    def handle_options(opts, state), do: {:ok, %{state | gain: opts[:gain], bb: opts[:bb]}}

    @impl BB.Estimator
    def handle_call(:gain, _from, state), do: {:reply, state.gain, state}
    def handle_call({:slow, ms}, _from, state), do: {:reply, :ok, %{state | slow_ms: ms}}

    def handle_call(:publish, _from, state),
      do: {:reply, :published, [bias: output(false)], state}

    def handle_call(:later, _from, state),
      do: {:reply, :published, [bias: output(false)], state, {:continue, :publish}}

    def handle_call(:nothing, _from, state), do: {:reply, :nothing, [], state}

    @impl BB.Estimator
    def handle_cast(:publish, state), do: {:reply, [out: output(false)], state}
    def handle_cast(:unknown, state), do: {:reply, [nowhere: output(false)], state}
    def handle_cast(:next, state), do: {:reply, [], state, {:continue, :publish}}

    @impl BB.Estimator
    def handle_continue(:publish, state), do: {:reply, [out: output(false)], state}

    @impl BB.Estimator
    def handle_info(:publish, state), do: {:reply, [out: output(false)], state}

    def handle_info(message, state) do
      tell(state, {:info, message})
      {:noreply, state}
    end

    defp output(pressed), do: Message.new!(Contact, :echo, pressed: pressed)
    defp tell(%{owner: owner}, message), do: if(Process.whereis(owner), do: send(owner, message))
  end

  defmodule Silent do
    use BB.Estimator

    @impl BB.Estimator
    def init(opts), do: {:ok, opts}

    @impl BB.Estimator
    def handle_input(_input, state), do: {:noreply, state}
  end

  defmodule Note do
    use BB.Command, options_schema: [owner: [type: :atom]]

    @impl BB.Command
    def handle_command(goal, _context, state) do
      if Process.whereis(state.owner), do: send(state.owner, {:command, goal})
      {:stop, :normal, state}
    end

    @impl BB.Command
    def result(_state), do: {:ok, :noted}
  end

  defmodule Robot do
    use BB

    parameters do
      param :gain, type: :integer, default: 3
    end

    commands do
      category :health, concurrency_limit: 10

      for name <- [:worse, :gone, :better] do
        command name,
          handler: {Note, owner: BB.EstimatorTest.Owner},
          allowed_states: :*,
          category: :health
      end
    end

    sensors do
      sensor :clock, Probe do
        estimator :drift, Silent
      end
    end

    topology do
      link :base do
        sensor :imu, Probe do
          estimator :echo, {Echo, owner: BB.EstimatorTest.Owner, gain: param([:gain])} do
            latency_budget ~u(50 millisecond)
            on_degraded :worse
            on_recovered :better
            recover_after 2
            output :bias, path: [:estimator, :bias]
            output :more
          end
        end

        sensor :range, Probe

        estimator :pose, {Echo, owner: BB.EstimatorTest.Owner} do
          input :imu, [:sensor, :base, :imu], driver?: true
          input :range, path: [:sensor, :base, :range]
          sync_tolerance ~u(1 millisecond)
          on_degraded :worse
        end

        joint :knee, type: :continuous do
          sensor :encoder, Probe do
            estimator :speed, {Echo, owner: BB.EstimatorTest.Owner} do
              lost_after ~u(50 millisecond)
              on_lost :gone
              on_degraded :worse
              on_recovered :better
            end
          end

          link :shin do
            estimator :chained, Silent do
              input :speed, [:sensor, :base, :knee, :encoder, :speed]
            end
          end
        end
      end
    end
  end

  setup context do
    Process.register(self(), BB.EstimatorTest.Owner)
    start_supervised!(Robot)
    eventually(fn -> Enum.all?(BB.Estimator.health(Robot), &(&1.state == :up)) end)
    if context[:telemetry], do: attach(context.telemetry)
    :ok
  end

  defp attach(events) do
    owner = self()
    id = {__MODULE__, owner}

    :ok =
      BB.Telemetry.attach_many(
        id,
        for(event <- events, do: [:bb, :estimator, event]),
        fn [:bb, :estimator, event], measurements, metadata, _config ->
          send(owner, {event, measurements, metadata})
        end,
        nil
      )

    on_exit(fn -> BB.Telemetry.detach(id) end)
  end

  defp contact(fields \\ []),
    do: struct!(Message.new!(Contact, :test, pressed: true), fields)

  defp publish(path, message), do: BB.publish(Robot, path, message)

  @imu [:sensor, :base, :imu]
  @range [:sensor, :base, :range]
  @encoder [:sensor, :base, :knee, :encoder]

  describe "an estimator" do
    test "in a sensor has its path, its frame and its options" do
      echo = BB.Process.whereis(Robot, :echo)
      assert_receive {:init, ^echo, opts}, 5_000
      context = opts[:estimator_context]
      path = @imu ++ [:echo]
      assert context == %Context{robot: Robot, path: path, target_frame: :imu, transforms: %{}}
      assert opts[:bb] == %{robot: Robot, path: path}
      assert opts[:gain] == 3
    end

    test "in a link has its path and its frame" do
      state = :sys.get_state(BB.Process.whereis(Robot, :pose)).user_state
      assert state.bb == %{robot: Robot, path: [:estimator, :base, :pose]}
      assert state.estimator_context.target_frame == :base
    end

    test "in a sensor of the robot or of a joint has its path" do
      drift = :sys.get_state(BB.Process.whereis(Robot, :drift)).user_state
      assert drift[:bb].path == [:sensor, :clock, :drift]
      speed = :sys.get_state(BB.Process.whereis(Robot, :speed)).user_state
      assert speed.bb.path == @encoder ++ [:speed]
    end

    test "follows the parameters of its options" do
      :ok = BB.Parameter.set(Robot, [:gain], 4)
      assert eventually(fn -> BB.call(Robot, :echo, :gain) == 4 end)
      state = :sys.get_state(BB.Process.whereis(Robot, :echo)).user_state
      assert state.bb.path == @imu ++ [:echo]
    end

    test "has the defaults of a component" do
      assert BB.call(Robot, :drift, :anything) == {:error, :not_implemented}
      BB.cast(Robot, :drift, :anything)
      BB.send(Robot, :drift, :anything)
      assert BB.call(Robot, :drift, :anything) == {:error, :not_implemented}
      assert Silent.options_schema() == %BB.Options{schema: []}
      assert Silent.handle_continue(1, 2) == {:noreply, 2}
    end

    test "is a component of its robot" do
      assert %{kind: BB.Estimator, path: [:base, :imu, :echo]} =
               component = Enum.find(Robot.robot().components, &(&1.name == :echo))

      assert BB.Component.data_path(component) == @imu ++ [:echo]
      assert BB.Estimator.explain(Echo, :oops) =~ "oops"
    end

    @tag :capture_log
    test "that crashes comes back" do
      pid = BB.Process.whereis(Robot, :echo)
      BB.cast(Robot, :echo, :unknown)
      eventually(fn -> BB.Process.whereis(Robot, :echo) not in [pid, :undefined] end)

      row = fn -> Enum.find(BB.Estimator.health(Robot), &(&1.name == :echo)) end
      eventually(fn -> row.().state == :up end)
      assert row.().error =~ "unknown output :nowhere of estimator :echo"
      publish(@imu, contact())
      assert_receive {:input, %Message{}}, 5_000
    end
  end

  describe "the input" do
    test "of an estimator in a sensor is the sensor's message" do
      message = contact()
      publish(@imu, message)
      assert_receive {:input, %Message{} = input}, 5_000
      assert input == %{message | robot: Robot}
    end

    test "is a message on exactly its path; all else goes to handle_info/2" do
      {:ok, _} = BB.subscribe(Robot, @imu ++ [:echo])
      publish(@imu ++ [:echo], contact())
      publish(@imu ++ [:other], contact())
      publish(@imu, contact())
      assert_receive {:input, %Message{}}, 5_000
      refute_received {:info, _}

      send(BB.Process.whereis(Robot, :echo), {:bb, [:elsewhere], contact()})
      assert_receive {:info, {:bb, [:elsewhere], %Message{}}}, 5_000
      send(BB.Process.whereis(Robot, :echo), :hello)
      assert_receive {:info, :hello}, 5_000
    end

    @tag telemetry: [:dropped]
    test "of several inputs is the newest of each, when the driver's arrives" do
      publish(@range, contact(monotonic_time: 1_000_000_000))
      publish(@range, contact(monotonic_time: 1_010_000_000))
      publish(@imu, contact(monotonic_time: 1_011_000_000))
      assert_receive {:input, %{imu: imu, range: range}}, 5_000
      assert {imu.monotonic_time, range.monotonic_time} == {1_011_000_000, 1_010_000_000}

      publish(@imu, contact(monotonic_time: 1_011_000_001))
      assert_receive {:dropped, %{count: 1}, metadata}, 5_000
      assert metadata == %{robot: Robot, estimator: :pose, reason: :sync_miss}
      assert_receive {:command, %{estimator: :pose} = goal}, 5_000

      assert goal == %{
               estimator: :pose,
               reason: :sync_miss,
               source_path: [:estimator, :base, :pose],
               previous_state: :healthy,
               new_state: :degraded
             }
    end

    @tag telemetry: [:dropped]
    test "of several inputs is dropped when one is missing" do
      publish(@imu, contact())
      assert_receive {:dropped, _measurements, %{estimator: :pose, reason: :sync_miss}}, 5_000
    end
  end

  describe "an output" do
    setup do
      {:ok, _} = BB.subscribe(Robot, @imu ++ [:echo])
      {:ok, _} = BB.subscribe(Robot, [:estimator, :bias])
      :ok
    end

    test "is published on its topic, from each callback" do
      publish(@imu, contact())
      topic = @imu ++ [:echo]
      assert_receive {:bb, ^topic, %{frame_id: :echo, payload: %{pressed: true}}}, 5_000

      for request <- [:publish, :next] do
        BB.cast(Robot, :echo, request)
        assert_receive {:bb, ^topic, %{payload: %{pressed: false}}}, 5_000
      end

      BB.send(Robot, :echo, :publish)
      assert_receive {:bb, ^topic, %{payload: %{pressed: false}}}, 5_000

      assert BB.call(Robot, :echo, :publish) == :published
      assert_receive {:bb, [:estimator, :bias], %{payload: %{pressed: false}}}, 5_000
      assert BB.call(Robot, :echo, :later) == :published
      assert_receive {:bb, ^topic, %{payload: %{pressed: false}}}, 5_000
      assert BB.call(Robot, :echo, :nothing) == :nothing
    end

    @tag telemetry: [:input, :output, :latency]
    test "is measured" do
      publish(@imu, contact())
      assert_receive {:input, %{count: 1}, %{robot: Robot, estimator: :echo}}, 5_000

      assert_receive {:output, %{count: 1}, %{robot: Robot, estimator: :echo, output: :out}},
                     5_000

      assert_receive {:latency, latency, %{robot: Robot, estimator: :echo}}, 5_000
      assert %{duration: duration, input_to_output: whole} = latency
      assert duration > 0 and whole >= duration
    end
  end

  describe "health" do
    @tag telemetry: [:transition]
    test "is worse after a slow input, and better after good ones" do
      BB.call(Robot, :echo, {:slow, 60})
      publish(@imu, contact())
      assert_receive {:command, %{estimator: :echo} = goal}, 5_000
      assert %{reason: :latency_overrun, previous_state: :healthy, new_state: :degraded} = goal
      assert goal.source_path == @imu ++ [:echo]
      assert_receive {:transition, %{count: 1}, %{estimator: :echo} = metadata}, 5_000
      assert %{previous_state: :healthy, new_state: :degraded} = metadata

      BB.call(Robot, :echo, {:slow, 0})
      for _ <- 1..2, do: publish(@imu, contact())
      assert_receive {:command, %{estimator: :echo, reason: :recovered} = goal}, 5_000
      assert %{previous_state: :degraded, new_state: :healthy} = goal
    end

    test "is lost without input, and returns by way of degraded" do
      assert_receive {:command, %{estimator: :speed, reason: :lost} = goal}, 5_000
      assert %{previous_state: :healthy, new_state: :lost} = goal
      publish(@encoder, contact())
      assert_receive {:command, %{estimator: :speed, new_state: :degraded} = goal}, 5_000
      assert goal.previous_state == :lost
    end

    test "executes commands of the robot" do
      {:ok, _} = BB.subscribe(Robot, [:command])
      assert_receive {:bb, [:command, :gone, _id], %{payload: %{status: :started}}}, 5_000
      eventually(fn -> not Runtime.executing?(Robot) end)
    end
  end
end

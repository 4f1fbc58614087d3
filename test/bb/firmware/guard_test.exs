defmodule BB.Firmware.GuardTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Robot

  alias BB.Firmware.Board.Memory
  alias BB.Firmware.Guard
  alias BB.Firmware.Guard.Heart
  alias BB.Firmware.Trial.Findings
  alias BB.Firmware.Trial
  alias BB.Message.Sensor.Range
  alias BB.Test.{Native, Network, Probe}

  @moduletag :tmp_dir

  defmodule Slow do
    @moduledoc "A sensor that publishes more seldom than a guard's samples are fresh, or never."

    use BB.Sensor, options_schema: [hz: [type: :any], silent: [type: :boolean, default: false]]

    @period_ms 500

    @impl BB.Sensor
    def init(opts) do
      send(self(), :publish)
      {:ok, opts}
    end

    @impl BB.Sensor
    def rate(opts), do: opts[:hz]

    @impl BB.Sensor
    def handle_info(:publish, opts) do
      Process.send_after(self(), :publish, @period_ms)
      contact = BB.Message.new!(BB.Message.Sensor.Contact, :slow, pressed: true)
      _ = if not opts[:silent], do: BB.Sensor.publish(opts[:bb], contact)
      {:noreply, opts}
    end
  end

  defmodule Terms do
    @moduledoc "An encoding in both directions."

    @behaviour BB.Handoff.Encoding

    @impl BB.Handoff.Encoding
    def content, do: "test/Terms"

    @impl BB.Handoff.Encoding
    def payload, do: Range

    @impl BB.Handoff.Encoding
    def encode(message), do: :erlang.term_to_binary(%{message | robot: nil})

    @impl BB.Handoff.Encoding
    def decode(bytes), do: {:ok, :erlang.binary_to_term(bytes)}
  end

  defp declared do
    robot do
      topology do
        link :base_link do
          sensor :range, BB.Test.Probe, required: true
          sensor :extra, BB.Test.Probe
        end
      end
    end
  end

  # A sensor that publishes every few milliseconds, as long as its robot lives.
  defp beating(robot, name, path) do
    publish = fn ->
      BB.publish(robot, [:sensor | path], range(name))
      Process.send_after(self(), :beat, 5)
    end

    Probe.script(robot, name,
      init: fn opts -> publish.() && {:ok, opts[:bb]} end,
      handle_info: fn :beat, state -> publish.() && {:noreply, state} end
    )
  end

  defp range(name) do
    BB.Message.new!(Range, name,
      radiation_type: :infrared,
      field_of_view: 0.1,
      min_range: 0.02,
      max_range: 1.5,
      range: 0.4
    )
  end

  defp guard(context, robot, opts \\ []) do
    {:ok, memory} =
      Memory.start_link(
        status: opts[:status] || :unvalidated,
        tell: self(),
        firmware: if(opts[:uuid], do: %{"nerves_fw_uuid" => opts[:uuid]}, else: %{})
      )

    topic = Native.topic("guard")

    defaults = [
      robot: robot,
      name: nil,
      board: {Memory, memory},
      network: {Network, start_supervised!({Network, opts[:state] || :lan}, id: make_ref())},
      stability_ms: 100,
      fresh_ms: 500,
      deadline_ms: 60_000,
      poll_ms: 10,
      folder: context.tmp_dir,
      topic: topic,
      started_ms: System.monotonic_time(:millisecond)
    ]

    opts = Keyword.drop(opts, [:status, :state, :uuid])
    {start_supervised!({Guard, Keyword.merge(defaults, opts)}), memory}
  end

  defp hopeless(opts), do: [deadline_ms: 300] ++ opts

  test "firmware with which the robot works is validated, with one heart callback that is cleared",
       context do
    robot = declared()
    beating(robot, :range, [:base_link, :range])
    start_supervised!(robot)
    {guard, memory} = guard(context, robot)

    heart = Heart.callback()
    assert_receive {Memory, {:set_heart, ^heart}}
    assert_receive {Memory, :init_complete}
    assert_receive {Memory, :validate}
    assert_receive {Memory, {:clear_heart, ^heart}}

    assert {:ok, %{phase: :validated, reasons: [], left_ms: nil}} = Guard.state(guard)
    assert Memory.heart(memory) == nil
    assert Findings.read(context.tmp_dir, :validated) =~ "validated at"
    refute_received {Memory, _}
  end

  test "firmware with a required sensor that is absent is reverted, and the report says why",
       context do
    robot = declared()
    Probe.script(robot, :range, init: fn _ -> {:stop, :no_device} end)
    start_supervised!(robot)
    {guard, _} = guard(context, robot, hopeless([]))

    assert_receive {Memory, :revert}
    refute_received {Memory, :validate}
    assert {:ok, %{phase: :reverting}} = Guard.state(guard)

    assert Findings.read(context.tmp_dir, :reverted) =~
             "required: sensor range: backoff: :no_device"
  end

  test "firmware with a required sensor that runs and says nothing is reverted", context do
    robot = quiet()
    {_, _} = guard(context, robot, hopeless([]))
    assert_receive {Memory, :revert}
    assert Findings.read(context.tmp_dir, :reverted) =~ "required: sensor range: was never good"
  end

  test "old samples of a required sensor are no samples", context do
    robot = quiet()

    Probe.script(robot, :range,
      handle_info: fn :old, state ->
        old = %{
          range(:range)
          | monotonic_time: System.monotonic_time(:nanosecond) - 10_000_000_000
        }

        BB.publish(robot, [:sensor, :base_link, :range], old)
        {:noreply, state}
      end
    )

    {_, _} = guard(context, robot, hopeless([]))
    assert_receive {Memory, :init_complete}
    for _ <- 1..10, do: BB.send(robot, :range, :old)
    assert_receive {Memory, :revert}
    assert Findings.read(context.tmp_dir, :reverted) =~ "required: sensor range: was never good"
  end

  for {how, fields, rate} <- [
        {"by its max_silence", [max_silence: BB.Unit.new!(5, :second)], nil},
        {"by its rate", [], 0.5}
      ] do
    test "firmware with a required sensor that is slow #{how} is validated", context do
      robot = slow_robot(unquote(Macro.escape(fields)), hz: unquote(rate))
      start_supervised!(robot)
      {_, _} = guard(context, robot, fresh_ms: 100, stability_ms: 700)
      assert_receive {Memory, :validate}, 30_000
    end
  end

  for hz <- [0, -5, -0.5, 1.0e-308, 1.0e308, Bitwise.bsl(1, 10_000), "50", {:ok, 50}] do
    test "firmware with a required sensor that declares #{inspect(hz) |> String.slice(0, 9)} Hz " <>
           "is validated, and health shows no such rate",
         context do
      robot = slow_robot([], Macro.escape(hz: unquote(Macro.escape(hz))))
      start_supervised!(robot)
      {_, _} = guard(context, robot, fresh_ms: 10_000, stability_ms: 700)
      assert_receive {Memory, :validate}, 30_000
      assert %{declared_hz: nil} = health(robot, :slow)
    end
  end

  test "a required sensor that is slow and says nothing is not good", context do
    robot = slow_robot([max_silence: BB.Unit.new!(5, :second)], silent: true)
    start_supervised!(robot)
    # One that the guard never sees up is not good for that reason.
    assert eventually(fn -> health(robot, :slow).state == :up end, 30_000)
    {_, _} = guard(context, robot, hopeless([]))
    assert_receive {Memory, :revert}
    assert Findings.read(context.tmp_dir, :reverted) =~ "required: sensor slow: was never good"
  end

  defp slow_robot(fields, options) do
    create(
      quote do
        sensors do
          sensor :slow,
                 {unquote(Slow), unquote(options)},
                 unquote(Macro.escape([required: true] ++ fields))
        end
      end
    )
  end

  test "firmware whose outlet, inlet and native process keep their max_silence is validated",
       context do
    {topic, frames} = {Native.topic("carried"), Native.topic("frames")}
    robot = carrying_robot(topic, frames)
    beating(robot, :range, [:range])
    start_supervised!(robot)
    carriers = [:outlet, :inlet, :camera]
    eventually(fn -> Enum.all?(carriers, &(health(robot, &1).state == :up)) end, 30_000)

    # Longer than each of them may be silent.
    {_, _} = guard(context, robot, stability_ms: 4_000)
    assert_receive {Memory, :validate}, 60_000
  end

  # What the sensor publishes goes onto the ring and comes back.
  defp carrying_robot(topic, frames) do
    fields = [required: true, max_silence: BB.Unit.new!(2, :second)]
    outlet = [from: [:sensor, :range], topic: topic, encoding: Terms]
    inlet = [topic: topic, encoding: Terms, to: [:sensor, :back]]
    camera = [program: "camera", topics: [topic: frames]]

    create(
      quote do
        sensors do
          sensor :range, BB.Test.Probe, required: true
          sensor :outlet, {BB.Handoff.Outlet, unquote(outlet)}, unquote(Macro.escape(fields))
          sensor :inlet, {BB.Handoff.Inlet, unquote(inlet)}, unquote(Macro.escape(fields))

          sensor :camera,
                 {BB.Sensor.NativeProcess, unquote(camera)},
                 unquote(Macro.escape(fields))
        end
      end
    )
  end

  test "a sensor that is not required may be absent: it is reported, and the firmware is validated",
       context do
    robot = declared()
    beating(robot, :range, [:base_link, :range])
    Probe.script(robot, :extra, init: fn _ -> {:stop, :no_device} end)
    start_supervised!(robot)
    {guard, _} = guard(context, robot)

    assert_receive {Memory, {:clear_heart, _}}
    assert {:ok, %{missing: [{{:sensor, :extra}, _}]}} = Guard.state(guard)

    assert Findings.read(context.tmp_dir, :validated) =~
             "optional: sensor extra: backoff: :no_device"
  end

  test "firmware without a network is reverted, unless none is asked for", context do
    robot = declared()
    beating(robot, :range, [:base_link, :range])
    start_supervised!(robot)

    guard(context, robot, hopeless(state: :disconnected))
    assert_receive {Memory, :revert}

    assert Findings.read(context.tmp_dir, :reverted) =~
             "network: disconnected, and lan is required"

    stop_supervised!(Guard)
    guard(context, robot, state: :disconnected, reach: :none)
    assert_receive {Memory, :validate}
  end

  test "firmware whose native process is started again and again is reverted", context do
    robot =
      robot do
        sensors do
          sensor :native, {BB.Sensor.NativeProcess, program: "false"}
        end
      end

    start_supervised!(robot)
    guard(context, robot, stability_ms: 800, deadline_ms: 1_200)
    assert_receive {Memory, :revert}
    assert Findings.read(context.tmp_dir, :reverted) =~ "required: native native: "
  end

  test "a robot that is not started at all is reverted", context do
    guard(context, declared(), hopeless([]))
    assert_receive {Memory, :revert}
    assert Findings.read(context.tmp_dir, :reverted) =~ "pubsub: "
  end

  test "a robot that starts after its guard is validated", context do
    robot = declared()
    beating(robot, :range, [:base_link, :range])
    {guard, _} = guard(context, robot)
    eventually(fn -> match?({:ok, %{phase: :watching}}, Guard.state(guard)) end)
    start_supervised!(robot)
    assert_receive {Memory, :validate}
  end

  test "a ring whose topic another publisher has is a reason", context do
    robot = declared()
    beating(robot, :range, [:base_link, :range])
    start_supervised!(robot)
    topic = Native.topic("taken")
    {:ok, publisher} = BB.Ring.Publisher.open(topic)
    guard(context, robot, hopeless(topic: topic))
    assert_receive {Memory, :revert}

    assert Findings.read(context.tmp_dir, :reverted) =~
             "required: ring: the topic has a live publisher"

    BB.Ring.Publisher.close(publisher)
  end

  test "the guard's topic has the prefix of the robot's settings", context do
    prefix = BB.Test.Run.unique("rover")
    robot = robot_with_prefix(prefix)
    beating(robot, :range, [:base_link, :range])
    start_supervised!(robot)
    topic = Native.topic("taken")
    {:ok, publisher} = BB.Ring.Publisher.open("#{prefix}.#{topic}")
    guard(context, robot, hopeless(topic: topic))
    assert_receive {Memory, :revert}
    assert Findings.read(context.tmp_dir, :reverted) =~ "required: ring: the topic has a live"
    BB.Ring.Publisher.close(publisher)
  end

  defp robot_with_prefix(prefix) do
    BB.Test.Robot.create(
      quote do
        settings topic_prefix: unquote(prefix)

        topology do
          link :base_link do
            sensor :range, BB.Test.Probe, required: true
          end
        end
      end
    )
  end

  for status <- [:validated, :unknown] do
    test "a board whose firmware is #{status} is told of the start and left alone", context do
      {guard, memory} = guard(context, declared(), hopeless(status: unquote(status)))
      assert_receive {Memory, :init_complete}
      assert {:ok, %{phase: :settled, status: unquote(status)}} = Guard.state(guard)
      assert Memory.heart(memory) == nil
      refute_received {Memory, _}
    end
  end

  describe "on a board that knows no such state, with an update that came in through the gate," do
    for status <- [:unknown, :validated] do
      test "firmware that works stays, though the board says #{status} of all", context do
        updated(context.tmp_dir, unquote(status))
        robot = declared()
        beating(robot, :range, [:base_link, :range])
        start_supervised!(robot)
        {guard, _} = guard(context, robot, status: unquote(status), uuid: "new")
        assert_receive {Memory, {:clear_heart, _}}, 30_000
        # Of such a board this would be said for ever.
        refute_received {Memory, :validate}
        assert {:ok, %{phase: :validated}} = Guard.state(guard)
        refute File.exists?(Path.join(context.tmp_dir, "trial.txt"))
      end

      test "firmware that does not work is reverted, though the board says #{status} of all",
           context do
        updated(context.tmp_dir, unquote(status))
        guard(context, quiet(), hopeless(status: unquote(status), uuid: "new"))
        assert_receive {Memory, {:set_heart, _}}, 30_000
        assert_receive {Memory, :revert}, 30_000

        assert Findings.read(context.tmp_dir, :reverted) =~
                 "required: sensor range: was never good"
      end
    end

    # The firmware before lets the update in, and the board restarts with it.
    defp updated(folder, status) do
      {:ok, old} = Memory.start_link(status: status, firmware: %{"nerves_fw_uuid" => "old"})
      :ok = Trial.accepted(folder, {Memory, old}, "the start before")
      :ok = Trial.written(folder)
    end
  end

  test "what the guard waits for is in the marker while it waits, and its verdict after",
       context do
    robot = quiet()
    guard(context, robot, uuid: "new")
    marker = Path.join(context.tmp_dir, "trial.txt")
    waits = "required: sensor range: was never good"

    eventually(
      fn -> match?({:ok, _}, File.read(marker)) and File.read!(marker) =~ waits end,
      30_000
    )

    # Heart restarts the board: the firmware before starts, and tells.
    {:ok, old} = Memory.start_link(status: :validated, firmware: %{"nerves_fw_uuid" => "old"})
    :ok = Trial.begin(context.tmp_dir, {Memory, old}, "the next start")
    report = Findings.read(context.tmp_dir, :reverted)
    assert report =~ "by the board: a power cut, its watchdog or its heart"
    assert report =~ "note: " <> waits
  end

  test "a revert by the guard is told as one by the guard, also by the firmware after it",
       context do
    {_, _} = guard(context, quiet(), hopeless(uuid: "new"))
    assert_receive {Memory, :revert}, 30_000
    report = Findings.read(context.tmp_dir, :reverted)
    assert report =~ "by its guard"
    {:ok, old} = Memory.start_link(status: :validated, firmware: %{"nerves_fw_uuid" => "old"})
    :ok = Trial.begin(context.tmp_dir, {Memory, old}, "the next start")
    assert Findings.read(context.tmp_dir, :reverted) == report
    assert Trial.refused?(context.tmp_dir, "new")
  end

  test "a guard that was killed decides by the same deadline, with the same heart callback",
       context do
    robot = quiet()
    started = System.monotonic_time(:millisecond)
    {guard, memory} = guard(context, robot, deadline_ms: 600, started_ms: started)
    assert_receive {Memory, {:set_heart, _}}
    Process.exit(guard, :kill)
    assert_receive {Memory, {:set_heart, _}}
    assert Memory.heart(memory) == Heart.callback()
    assert_receive {Memory, :revert}
  end

  test "a validation that fails is tried again", context do
    robot = declared()
    beating(robot, :range, [:base_link, :range])
    start_supervised!(robot)
    {_, memory} = guard(context, robot, status: :unvalidated, stability_ms: 200)
    Memory.answer(memory, :validate, {:error, :timeout})
    assert_receive {Memory, :validate}
    Memory.answer(memory, :validate, nil)
    assert_receive {Memory, :validate}
    assert_receive {Memory, {:clear_heart, _}}
  end

  test "says that it is not running when it is not" do
    assert Guard.state(:no_guard_of_this_name) == {:error, :not_running}
  end

  test "refuses wrong options" do
    assert_raise BB.Options.ValidationError, ~r/required :robot/, fn -> Guard.start_link([]) end
  end

  defp quiet do
    robot = declared()
    start_supervised!(robot, id: make_ref())
    robot
  end
end

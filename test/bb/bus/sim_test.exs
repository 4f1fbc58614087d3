defmodule BB.Bus.SimTest do
  use ExUnit.Case, async: true

  import ExUnit.CaptureLog

  alias BB.Bus.Sim
  alias BB.Bus.Sim.I2C

  doctest BB.Bus.Sim
  doctest BB.Bus.Sim.Fault

  # Remembers the bytes written last and reads them back, repeated.
  defmodule Echo do
    @behaviour BB.Bus.Sim.Device

    @impl true
    def init(opts, now_ns) do
      opts = Keyword.validate!(opts, last: "?", error: nil, do: nil)
      if opts[:do], do: opts[:do].()

      if opts[:error],
        do: {:error, opts[:error]},
        else: {:ok, %{last: opts[:last], powered_ns: now_ns}}
    end

    @impl true
    def write("nak", _now_ns, echo), do: {:nak, echo}
    def write("crash", _now_ns, _echo), do: raise("a bug in the model")
    def write("throw", _now_ns, _echo), do: throw(:ball)
    def write(data, _now_ns, echo), do: {:ok, %{echo | last: data}}

    @impl true
    def read(13, _now_ns, echo), do: {:ok, "too short", echo}
    def read(count, _now_ns, %{last: "time"} = echo), do: {:ok, stamp(count, echo), echo}

    def read(count, _now_ns, echo) do
      {:ok, binary_part(String.duplicate(echo.last, count), 0, count), echo}
    end

    # An interrupt pin that fails, as an order selects.
    @impl true
    def pulses(_from_ns, _to_ns, %{last: "throw pulses"}), do: throw(:ball)
    def pulses(_from_ns, _to_ns, %{last: "exit pulses"}), do: exit(:pulse)
    def pulses(_from_ns, _to_ns, %{last: "wrong pulses"}), do: [:wrong]
    def pulses(_from_ns, _to_ns, _echo), do: nil

    defp stamp(8, echo), do: <<echo.powered_ns::64>>
  end

  setup context do
    name = "i2c-#{:erlang.phash2(context.test)}"

    start_supervised!(
      {Sim, buses: %{name => [devices: %{0x10 => {Echo, []}, 0x11 => {Echo, []}}]}}
    )

    {:ok, bus} = I2C.open(name)
    %{name: name, bus: bus}
  end

  describe "a bus" do
    test "is listed while it runs", %{name: name} do
      assert name in Sim.names()
      assert name in I2C.bus_names()
    end

    test "lists its devices", %{name: name, bus: bus} do
      :ok = I2C.write(bus, 0x10, "a")
      :ok = Sim.fault(name, 0x11, :nak)

      assert Sim.devices(name) == %{
               0x10 => %{module: Echo, plugged?: true, fault: nil, broken?: false, transfers: 1},
               0x11 => %{module: Echo, plugged?: true, fault: :nak, broken?: false, transfers: 0}
             }
    end

    test "that does not exist is an error for each order" do
      for order <- [:unplug, :replug, :clear] do
        assert apply(Sim, order, ["i2c-none", 0x10]) == {:error, :bus_not_found}
      end

      assert Sim.fault("i2c-none", 0x10, :nak) == {:error, :bus_not_found}
      assert Sim.plug("i2c-none", 0x10, {Echo, []}) == {:error, :bus_not_found}
      assert Sim.devices("i2c-none") == {:error, :bus_not_found}
    end

    test "lives beside others in one VM", %{name: name} do
      other = name <> "-other"
      start_supervised!({Sim, buses: %{other => [devices: %{0x20 => {Echo, []}}]}})
      assert I2C.detect_devices(name) == [0x10, 0x11]
      assert I2C.detect_devices(other) == [0x20]
    end

    test "is not started twice under one name", %{name: name} do
      Process.flag(:trap_exit, true)

      assert {:error, {:shutdown, {:failed_to_start_child, ^name, {:already_started, _pid}}}} =
               Sim.start_link(buses: %{name => []})
    end

    test "is not started with options that it does not know" do
      Process.flag(:trap_exit, true)
      assert {:error, {:shutdown, _}} = Sim.start_link(buses: %{"i2c-bad" => [speed: 1]})
      assert {:error, {%ArgumentError{message: message}, _}} = Sim.start_link(bus: "i2c-bad")
      assert message =~ "expected buses: %{name => options}"
    end

    test "gives its devices the time of its own clock", %{name: name} do
      other = name <> "-other"

      start_supervised!(
        {Sim, buses: %{other => [devices: %{8 => {Echo, last: "time"}}, clock: fn -> 42 end]}}
      )

      {:ok, bus} = I2C.open(other)
      assert I2C.read(bus, 8, 8) == {:ok, <<42::64>>}
    end
  end

  describe "a bus whose clock is stepped" do
    test "gives its devices the time of the robot", %{name: name} do
      start_supervised!({BB.Clock.Stepped, robot: __MODULE__.Robot})
      clock = BB.Clock.of(__MODULE__.Robot)
      other = name <> "-stepped"
      buses = %{other => [devices: %{8 => {Echo, last: "time"}}, clock: clock]}
      start_supervised!({Sim, buses: buses})
      {:ok, bus} = I2C.open(other)
      started_ns = BB.Clock.now_ns(clock)
      assert I2C.read(bus, 8, 8) == {:ok, <<started_ns::signed-64>>}

      BB.Clock.Stepped.advance(__MODULE__.Robot, 5_000_000)
      :ok = Sim.unplug(other, 8)
      :ok = Sim.replug(other, 8)
      assert I2C.read(bus, 8, 8) == {:ok, <<started_ns + 5_000_000::signed-64>>}
    end

    test "is not one without a clock", %{name: name} do
      Process.flag(:trap_exit, true)

      assert {:error, {:shutdown, reason}} =
               Sim.start_link(buses: %{(name <> "-no") => [clock: 7]})

      assert inspect(reason) =~ "expected clock:"
    end
  end

  describe "a device's interrupt pin" do
    # Pulses every 5 ms while it has a line.
    defmodule Pulsing do
      @behaviour BB.Bus.Sim.Device

      @period_ns 5_000_000

      @impl true
      def init([line: line], now_ns), do: {:ok, %{line: line, on?: true, start_ns: now_ns}}

      @impl true
      def write(<<on>>, _now_ns, state), do: {:ok, %{state | on?: on == 1}}

      @impl true
      def read(_count, _now_ns, state), do: {:nak, state}

      @impl true
      def pulses(_from_ns, _to_ns, %{on?: false}), do: nil

      def pulses(from_ns, to_ns, state) do
        [first, next] = for t <- [from_ns, to_ns], do: div(t - state.start_ns, @period_ns) + 1

        times_ns = for n <- first..(next - 1)//1, do: state.start_ns + n * @period_ns
        next_ns = state.start_ns + next * @period_ns
        %{line: state.line, width_ns: 50_000, times_ns: times_ns, next_ns: next_ns}
      end
    end

    setup %{name: name} do
      robot = Module.concat(__MODULE__, name)
      start_supervised!({BB.Clock.Stepped, robot: robot})
      clock = BB.Clock.of(robot)
      start_supervised!({Sim.Lines, chips: %{name => [clock: clock]}})
      devices = %{0x20 => {Pulsing, line: {name, 4}}}
      bus = name <> "-pulsing"
      start_supervised!({Sim, buses: %{bus => [devices: devices, clock: clock]}}, id: :pulsing)
      {:ok, line} = Sim.GPIO.open({name, 4}, :input, pull_mode: :pullup)
      :ok = Sim.GPIO.set_interrupts(line, :rising)
      %{robot: robot, pin: {name, 4}, pulsing: bus, from_ns: BB.Clock.now_ns(clock)}
    end

    test "drives its line at the very times", context do
      BB.Clock.Stepped.advance(context.robot, 20_000_000)
      assert stamps(context) == [5_000_000, 10_000_000, 15_000_000, 20_000_000]
      assert Sim.Lines.level(context.pin) == 1
      BB.Clock.Stepped.advance(context.robot, 100_000)
      assert Sim.Lines.level(context.pin) == 0
    end

    test "is driven at once when its device changes, and let go when that is unplugged",
         context do
      {:ok, bus} = I2C.open(context.pulsing)
      BB.Clock.Stepped.advance(context.robot, 12_000_000)
      :ok = I2C.write(bus, 0x20, <<0>>)
      assert Sim.Lines.level(context.pin) == 1
      BB.Clock.Stepped.advance(context.robot, 10_000_000)
      :ok = I2C.write(bus, 0x20, <<1>>)
      BB.Clock.Stepped.advance(context.robot, 10_000_000)
      Sim.unplug(context.pulsing, 0x20)
      BB.Clock.Stepped.advance(context.robot, 10_000_000)

      # A line that is let go follows the pull of its pin.
      let_go = [12_000_000, 32_000_000]
      assert stamps(context) -- let_go == [5_000_000, 10_000_000, 25_000_000, 30_000_000]
    end

    defp stamps(%{pin: line, from_ns: from_ns} = context) do
      receive do
        {:circuits_gpio, ^line, time_ns, 1} -> [time_ns - from_ns | stamps(context)]
      after
        0 -> []
      end
    end
  end

  describe "plugging" do
    test "an unplugged device does not answer", %{name: name, bus: bus} do
      :ok = Sim.unplug(name, 0x10)
      assert I2C.read(bus, 0x10, 1) == {:error, :i2c_nak}
      assert I2C.write(bus, 0x10, "a") == {:error, :i2c_nak}
      assert I2C.write_read(bus, 0x10, "a", 1) == {:error, :i2c_nak}
      assert I2C.detect_devices(bus) == [0x11]
      assert :ok = Sim.unplug(name, 0x10)
    end

    test "a replugged device has lost its state", %{name: name, bus: bus} do
      :ok = I2C.write(bus, 0x10, "a")
      :ok = Sim.unplug(name, 0x10)
      :ok = Sim.replug(name, 0x10)
      assert I2C.read(bus, 0x10, 1) == {:ok, "?"}
    end

    test "a device that is plugged in is not changed by replugging", %{name: name, bus: bus} do
      :ok = I2C.write(bus, 0x10, "a")
      :ok = Sim.replug(name, 0x10)
      assert I2C.read(bus, 0x10, 1) == {:ok, "a"}
    end

    test "a new device answers at once", %{name: name, bus: bus} do
      assert Sim.plug(name, 0x20, {Echo, last: "new"}) == :ok
      assert I2C.read(bus, 0x20, 3) == {:ok, "new"}
    end

    test "an address is taken until its device is unplugged", %{name: name, bus: bus} do
      assert Sim.plug(name, 0x10, {Echo, []}) == {:error, :address_taken}
      :ok = Sim.unplug(name, 0x10)
      assert Sim.plug(name, 0x10, {Echo, last: "b"}) == :ok
      assert I2C.read(bus, 0x10, 1) == {:ok, "b"}
    end

    test "nothing can be done to an address where nothing ever was", %{name: name} do
      assert Sim.unplug(name, 0x30) == {:error, :no_device}
      assert Sim.replug(name, 0x30) == {:error, :no_device}
      assert Sim.fault(name, 0x30, :nak) == {:error, :no_device}
      assert Sim.clear(name, 0x30) == {:error, :no_device}
    end

    test "a device's wrong options raise for the caller and leave the bus alone", %{
      name: name,
      bus: bus
    } do
      assert_raise ArgumentError, ~r/unknown/, fn -> Sim.plug(name, 0x20, {Echo, colour: 1}) end
      assert Sim.plug(name, 0x20, {Echo, error: :enoent}) == {:error, :enoent}
      assert I2C.detect_devices(bus) == [0x10, 0x11]
    end
  end

  describe "a fault" do
    test "lasts until it is cleared and spares the registers", %{name: name, bus: bus} do
      :ok = I2C.write(bus, 0x10, "a")
      :ok = Sim.fault(name, 0x10, :nak)
      for _ <- 1..3, do: assert(I2C.read(bus, 0x10, 1) == {:error, :i2c_nak})
      :ok = Sim.clear(name, 0x10)
      assert I2C.read(bus, 0x10, 1) == {:ok, "a"}
    end

    test "lasts for the number of its attempts", %{name: name, bus: bus} do
      :ok = Sim.fault(name, 0x10, {:nak, 2})
      assert I2C.read(bus, 0x10, 1) == {:error, :i2c_nak}
      assert I2C.read(bus, 0x10, 1) == {:error, :i2c_nak}
      assert I2C.read(bus, 0x10, 1) == {:ok, "?"}
    end

    test "of one device does not touch its neighbour", %{name: name, bus: bus} do
      :ok = Sim.fault(name, 0x10, :nak)
      assert I2C.read(bus, 0x11, 1) == {:ok, "?"}
    end

    test "has the error atoms of Circuits", %{name: name, bus: bus} do
      for {fault, error} <-
            [nak: :i2c_nak, enxio: :enxio, retry: :retry] ++ [{{:errno, 5}, {:errno, 5}}] do
        :ok = Sim.fault(name, 0x10, {fault, 1})
        assert I2C.read(bus, 0x10, 1) == {:error, error}
      end
    end

    test "is overcome by as many retries", %{name: name, bus: bus} do
      :ok = Sim.fault(name, 0x10, {:nak, 2})
      assert I2C.read(bus, 0x10, 1, retries: 2) == {:ok, "?"}
      {:ok, stubborn} = I2C.open(name, retries: 2)
      :ok = Sim.fault(name, 0x10, {:nak, 3})
      assert I2C.read(stubborn, 0x10, 1) == {:error, :i2c_nak}
      assert I2C.read(stubborn, 0x10, 1, retries: 0) == {:ok, "?"}
    end

    test "that is invalid raises", %{name: name} do
      for wrong <-
            [:broken, {:nak, 0}, {:nak, :once}, {:errno, 0}, nil, {:slow, 0}, {:bit_errors, 0}] ++
              [
                {:bit_errors, 1.1},
                {:bit_errors, 1, :seed},
                {:twin, Echo},
                {{:twin, {Echo, []}}, 1}
              ] do
        assert_raise ArgumentError, ~r/expected a fault/, fn -> Sim.fault(name, 0x10, wrong) end
      end
    end

    test "is cleared when the device is unplugged", %{name: name, bus: bus} do
      :ok = Sim.fault(name, 0x10, :nak)
      :ok = Sim.unplug(name, 0x10)
      :ok = Sim.replug(name, 0x10)
      assert I2C.read(bus, 0x10, 1) == {:ok, "?"}
    end
  end

  describe "a timeout" do
    test "takes at least the time the bus was opened with", %{name: name} do
      {:ok, bus} = I2C.open(name, timeout: 30)
      :ok = Sim.fault(name, 0x10, :timeout)
      {elapsed_us, answer} = :timer.tc(fn -> I2C.read(bus, 0x10, 1) end)
      assert answer == {:error, :timeout}
      assert elapsed_us >= 30_000
    end

    test "takes its time again for each retry", %{name: name} do
      {:ok, bus} = I2C.open(name, timeout: 10)
      :ok = Sim.fault(name, 0x10, :timeout)
      {elapsed_us, answer} = :timer.tc(fn -> I2C.read(bus, 0x10, 1, retries: 2) end)
      assert answer == {:error, :timeout}
      assert elapsed_us >= 30_000
    end

    test "holds the bus for the others, and orders are obeyed meanwhile", %{name: name} do
      {:ok, bus} = I2C.open(name, timeout: 500)
      :ok = Sim.fault(name, 0x10, {:timeout, 2})
      test = self()
      started_ms = now_ms()
      spawn_link(fn -> send(test, {:stuck, I2C.read(bus, 0x10, 1), now_ms()}) end)
      wait_until(fn -> held?(name) end)
      spawn_link(fn -> send(test, {:waited, I2C.read(bus, 0x11, 1), now_ms()}) end)

      assert Sim.clear(name, 0x10) == :ok
      assert %{0x11 => %{transfers: 0}} = Sim.devices(name)
      assert_receive {:stuck, {:error, :timeout}, _}
      assert_receive {:waited, {:ok, "?"}, ended_ms}
      assert ended_ms - started_ms >= 500
    end

    defp now_ms, do: System.monotonic_time(:millisecond)

    # The first attempt has met the fault, so it holds the bus.
    defp held?(name), do: Sim.devices(name)[0x10].fault == {:timeout, 1}

    defp wait_until(condition), do: if(condition.(), do: :ok, else: wait_until(condition))
  end

  describe "a slow device" do
    test "answers, after holding the bus", %{name: name} do
      {:ok, bus} = I2C.open(name, timeout: 50)
      :ok = Sim.fault(name, 0x10, {:slow, 20})
      {elapsed_us, answer} = :timer.tc(fn -> I2C.read(bus, 0x10, 1) end)
      assert answer == {:ok, "?"}
      assert elapsed_us >= 20_000
    end

    test "that is as slow as the timeout is too slow", %{name: name} do
      {:ok, bus} = I2C.open(name, timeout: 10)
      :ok = Sim.fault(name, 0x10, {{:slow, 10}, 1})
      assert I2C.write(bus, 0x10, "a") == {:error, :timeout}
      assert I2C.read(bus, 0x10, 1) == {:ok, "?"}
    end
  end

  describe "bit errors" do
    test "flip a bit of each byte, written or read, with their probability", %{
      name: name,
      bus: bus
    } do
      :ok = Sim.fault(name, 0x10, {:bit_errors, 1})
      :ok = I2C.write(bus, 0x10, "aa")
      :ok = Sim.clear(name, 0x10)
      {:ok, written} = I2C.read(bus, 0x10, 2)
      for <<byte <- written>>, do: assert(byte in flipped(?a))

      :ok = Sim.fault(name, 0x11, {{:bit_errors, 1}, 1})
      {:ok, read} = I2C.read(bus, 0x11, 3)
      for <<byte <- read>>, do: assert(byte in flipped(??))
      assert I2C.read(bus, 0x11, 3) == {:ok, "???"}
    end

    test "of one seed are the same each time", %{name: name, bus: bus} do
      [one, two] =
        for _ <- 1..2 do
          :ok = Sim.fault(name, 0x10, {:bit_errors, 0.5, 17})
          I2C.read(bus, 0x10, 100)
        end

      assert one == two
      assert one != {:ok, String.duplicate("?", 100)}
    end

    defp flipped(byte), do: for(bit <- 0..7, do: Bitwise.bxor(byte, Bitwise.bsl(1, bit)))
  end

  describe "two devices at one address" do
    test "are read as the AND of both", %{name: name, bus: bus} do
      :ok = I2C.write(bus, 0x10, <<0b1100>>)
      :ok = Sim.fault(name, 0x10, {:twin, {Echo, last: <<0b1010>>}})
      assert I2C.read(bus, 0x10, 2) == {:ok, <<0b1000, 0b1000>>}
      :ok = Sim.clear(name, 0x10)
      assert I2C.read(bus, 0x10, 1) == {:ok, <<0b1100>>}
    end

    test "both get the bytes that are written", %{name: name, bus: bus} do
      :ok = Sim.fault(name, 0x10, {:twin, {Echo, last: <<0>>}})
      assert I2C.write(bus, 0x10, "both") == :ok
      assert I2C.read(bus, 0x10, 4) == {:ok, "both"}
    end

    test "one acknowledgement is enough", %{name: name, bus: bus} do
      capture_log(fn -> assert I2C.write(bus, 0x10, "crash") == {:error, :i2c_nak} end)
      :ok = Sim.fault(name, 0x10, {:twin, {Echo, last: "2"}})
      assert I2C.read(bus, 0x10, 1) == {:ok, "2"}
      assert I2C.write(bus, 0x10, "nak") == {:error, :i2c_nak}
    end

    test "a second one whose options are wrong raises for the caller", %{name: name, bus: bus} do
      assert_raise ArgumentError, ~r/unknown/, fn ->
        Sim.fault(name, 0x10, {:twin, {Echo, colour: 1}})
      end

      assert Sim.fault(name, 0x10, {:twin, {Echo, error: :enoent}}) == {:error, :enoent}
      assert I2C.read(bus, 0x10, 1) == {:ok, "?"}
    end
  end

  describe "a stuck bus" do
    test "times out for every address until it is released", %{name: name} do
      {:ok, bus} = I2C.open(name, timeout: 10)
      :ok = I2C.write(bus, 0x10, "a")
      :ok = Sim.stuck(name)

      for address <- [0x10, 0x11, 0x12],
          do: assert(I2C.read(bus, address, 1) == {:error, :timeout})

      :ok = Sim.release(name)
      assert I2C.read(bus, 0x10, 1) == {:ok, "a"}
      assert I2C.read(bus, 0x12, 1) == {:error, :i2c_nak}
    end

    test "that does not exist is an error" do
      assert Sim.stuck("i2c-none") == {:error, :bus_not_found}
      assert Sim.release("i2c-none") == {:error, :bus_not_found}
    end
  end

  describe "a bus with a clock" do
    test "makes transfers take their time on the whole", %{name: name} do
      other = name <> "-slow"

      start_supervised!(
        {Sim, buses: %{other => [clock_hz: 100_000, devices: %{0x10 => {Echo, []}}]}}
      )

      {:ok, bus} = I2C.open(other)

      {elapsed_us, :ok} =
        :timer.tc(fn ->
          Enum.each(1..20, fn _ -> {:ok, _} = I2C.write_read(bus, 0x10, "a", 14) end)
        end)

      # 17 bytes of 9 bits: 1.53 ms each; the last may be answered up to 1 ms early.
      assert elapsed_us >= 20 * 1530 - 1000
    end
  end

  describe "a bug in a device's model" do
    test "refuses it, whether it raises, throws or exits, and leaves the bus alone", context do
      %{name: name, bus: bus} = context

      for hurt <- [fn -> raise("not today") end, fn -> throw(:no) end, fn -> exit(:no) end] do
        assert_raise RuntimeError, ~r/not today|could not start simulated device/, fn ->
          Sim.plug(name, 0x12, {Echo, do: hurt})
        end

        :ok = Sim.unplug(name, 0x11)
        assert I2C.read(bus, 0x10, 1) == {:ok, "?"}
        :ok = Sim.replug(name, 0x11)
      end
    end

    test "in the pulses of its interrupt pin affects neither the device nor the bus", context do
      %{name: name, bus: bus} = context

      for text <- ["throw pulses", "exit pulses", "wrong pulses"] do
        assert I2C.write(bus, 0x10, text) == :ok
        assert I2C.read(bus, 0x10, byte_size(text)) == {:ok, text}
        assert I2C.read(bus, 0x11, 1) == {:ok, "?"}
      end

      assert %{0x10 => %{broken?: false}} = Sim.devices(name)
    end

    test "takes that device off the bus until it is plugged in again, and is logged", %{
      name: name,
      bus: bus
    } do
      log = capture_log(fn -> assert I2C.write(bus, 0x10, "crash") == {:error, :i2c_nak} end)
      assert log =~ "a bug in the model"
      assert I2C.read(bus, 0x10, 1) == {:error, :i2c_nak}
      assert I2C.read(bus, 0x11, 1) == {:ok, "?"}
      assert %{0x10 => %{broken?: true}} = Sim.devices(name)

      :ok = Sim.replug(name, 0x10)
      assert I2C.read(bus, 0x10, 1) == {:ok, "?"}
    end

    test "is also an answer of the wrong length, or a throw", %{name: name, bus: bus} do
      capture_log(fn -> assert I2C.read(bus, 0x10, 13) == {:error, :i2c_nak} end)
      capture_log(fn -> assert I2C.write(bus, 0x11, "throw") == {:error, :i2c_nak} end)
      assert %{0x10 => %{broken?: true}, 0x11 => %{broken?: true}} = Sim.devices(name)
    end
  end
end

defmodule BB.Bus.Sim.LinesTest do
  use ExUnit.Case, async: true

  alias BB.Bus.Sim.{Contact, GPIO, Lines}
  alias BB.Clock
  alias BB.Clock.Stepped

  doctest Lines

  @ms 1_000_000

  # Turns its lamp each time its key goes down, and 5 ms after that; an order breaks it.
  defmodule Toggle do
    @behaviour BB.Bus.Sim.GPIO.Device

    @impl true
    def pins, do: [:key, :lamp]

    @impl true
    def init(opts, _now_ns) do
      Keyword.validate!(opts, lit: 0)
      {:ok, %{lit: 0}, [{:drive, :lamp, 0}]}
    end

    @impl true
    def level(:key, 0, now_ns, state) do
      {state, [{:at, now_ns, :turn}, {:at, now_ns + 5_000_000, :turn}]}
    end

    def level(:key, 1, _now_ns, state), do: {state, []}

    @impl true
    def due(:turn, _now_ns, %{lit: lit} = state),
      do: {%{state | lit: 1 - lit}, [{:drive, :lamp, 1 - lit}]}

    @impl true
    def order(:break, _now_ns, _state), do: raise("broken on purpose")
    def order(:throw, _now_ns, _state), do: throw(:on_purpose)
    def order(:exit, _now_ns, _state), do: exit(:on_purpose)
    def order(:wrong, _now_ns, _state), do: {:what, :is, :this}
    def order(:stateless, _now_ns, _state), do: {:no_list, :of_effects}
    def order(:forget, _now_ns, state), do: {state, [:cancel]}
    def order(_order, _now_ns, _state), do: :error
  end

  setup context do
    unique = System.unique_integer([:positive])
    robot = Module.concat(__MODULE__, "Robot#{unique}")
    start_supervised!({Stepped, robot: robot})
    chip = "gpiochip-lines-#{unique}"
    options = Map.get(context, :chip, [])
    start_supervised!({Lines, chips: %{chip => [clock: Clock.of(robot)] ++ options}})
    %{robot: robot, chip: chip, clock: Clock.of(robot)}
  end

  defp listen!(chip, offset, opts \\ []) do
    {:ok, line} = GPIO.open({chip, offset}, :input, opts)
    :ok = GPIO.set_interrupts(line, :both)
    line
  end

  describe "a drive with a time" do
    test "happens at its time and carries it", %{robot: robot, chip: chip, clock: clock} do
      listen!(chip, 4)
      start_ns = Clock.now_ns(clock)
      :ok = Lines.drive({chip, 4}, 1, by: :imu, at_ns: start_ns + 3 * @ms)
      :ok = Lines.drive({chip, 4}, 0, by: :imu, at_ns: start_ns + 1 * @ms)
      :ok = Lines.drive({chip, 4}, 1, by: :imu, at_ns: start_ns)
      assert_received {:circuits_gpio, {^chip, 4}, ^start_ns, 1}

      :ok = Stepped.advance(robot, 2 * @ms)
      first_ns = start_ns + 1 * @ms
      assert_received {:circuits_gpio, {^chip, 4}, ^first_ns, 0}
      refute_received {:circuits_gpio, _, _, _}

      :ok = Stepped.advance(robot, 2 * @ms)
      second_ns = start_ns + 3 * @ms
      assert_received {:circuits_gpio, {^chip, 4}, ^second_ns, 1}
    end

    test "may be taken back", %{robot: robot, chip: chip, clock: clock} do
      listen!(chip, 4)
      :ok = Lines.drive({chip, 4}, 1, by: :imu, at_ns: Clock.now_ns(clock) + @ms)
      :ok = Lines.release({chip, 4}, by: :imu)
      :ok = Stepped.advance(robot, 2 * @ms)
      refute_received {:circuits_gpio, _, _, _}
    end

    @tag chip: [timestamp_offset_ns: -77]
    test "is stamped by another clock than Erlang's, as the kernel's", context do
      %{chip: chip, clock: clock} = context
      listen!(chip, 4)
      :ok = Lines.drive({chip, 4}, 1)
      stamp_ns = Clock.now_ns(clock) - 77
      assert_received {:circuits_gpio, {^chip, 4}, ^stamp_ns, 1}
    end
  end

  test "with the machine's clock it happens too, with the timestamp of its time" do
    chip = "gpiochip-real-#{System.unique_integer([:positive])}"
    start_supervised!({Lines, chips: %{chip => []}}, id: :real)
    listen!(chip, 4)
    at_ns = Clock.now_ns(:real) + 2 * @ms
    :ok = Lines.drive({chip, 4}, 1, at_ns: at_ns)
    assert_receive {:circuits_gpio, {^chip, 4}, ^at_ns, 1}
  end

  describe "a device" do
    test "gets the levels of its lines and drives them, now and later", %{
      robot: robot,
      chip: chip
    } do
      :ok = Lines.drive({chip, 1}, 1)
      :ok = Lines.plug(chip, :toggle, {Toggle, pins: [key: 1, lamp: 2]})
      :ok = Lines.drive({chip, 1}, 0)
      :ok = Stepped.advance(robot, 0)
      assert Lines.level({chip, 2}) == 1
      :ok = Stepped.advance(robot, 4 * @ms)
      assert Lines.level({chip, 2}) == 1
      :ok = Stepped.advance(robot, 1 * @ms)
      assert Lines.level({chip, 2}) == 0
    end

    test "that is unplugged drives nothing, and is as new when it is plugged in again", context do
      %{robot: robot, chip: chip} = context
      :ok = Lines.drive({chip, 1}, 1)
      :ok = Lines.drive({chip, 2}, :pullup)
      :ok = Lines.plug(chip, :toggle, {Toggle, pins: [key: 1, lamp: 2]})
      assert Lines.level({chip, 2}) == 0
      :ok = Lines.drive({chip, 1}, 0)
      assert Lines.unplug(chip, :toggle) == :ok
      assert Lines.level({chip, 2}) == 1
      :ok = Stepped.advance(robot, 10 * @ms)
      assert Lines.level({chip, 2}) == 1
      assert Lines.tell(chip, :toggle, :forget) == {:error, :no_device}
      assert Lines.replug(chip, :toggle) == :ok
      assert Lines.level({chip, 2}) == 0
    end

    @tag capture_log: true
    test "whose model raises, throws, exits or returns nonsense lets go, and the others work",
         context do
      %{chip: chip} = context
      :ok = Lines.drive({chip, 2}, :pullup)
      :ok = Lines.plug(chip, :toggle, {Toggle, pins: [key: 1, lamp: 2]})
      :ok = Lines.plug(chip, :contact, {Contact, pins: [contact: 3]})

      for hurt <- [:break, :throw, :exit, :wrong, :stateless] do
        assert Lines.tell(chip, :toggle, hurt) == :ok
        assert Lines.level({chip, 2}) == 1
        assert %{toggle: %{broken?: true}, contact: %{broken?: false}} = Lines.devices(chip)
        assert Lines.tell(chip, :contact, :press) == :ok
        assert Lines.replug(chip, :toggle) == :ok
        assert Lines.level({chip, 2}) == 0
      end
    end

    test "that is wrong is refused, here", %{chip: chip} do
      assert_raise ArgumentError, ~r/expected pins: .*\[:key, :lamp\], got: \[key: 1\]/, fn ->
        Lines.plug(chip, :toggle, {Toggle, pins: [key: 1]})
      end

      assert_raise ArgumentError, fn ->
        Lines.plug(chip, :toggle, {Toggle, pins: [key: 1, lamp: 54]})
      end

      assert_raise ArgumentError, fn ->
        Lines.plug(chip, :toggle, {Toggle, pins: [key: 1, lamp: 2], lit: 1, loud: true})
      end

      :ok = Lines.plug(chip, :toggle, {Toggle, pins: [key: 1, lamp: 2]})

      assert Lines.plug(chip, :toggle, {Toggle, pins: [key: 3, lamp: 4]}) ==
               {:error, :name_taken}

      assert Lines.tell(chip, :toggle, :sing) == {:error, :unknown_order}
      assert Lines.tell(chip, :nobody, :press) == {:error, :no_device}
    end
  end

  describe "a fault" do
    test "is there until it is cleared, and seen as edges", %{chip: chip} do
      :ok = Lines.drive({chip, 4}, 0)
      listen!(chip, 4, pull_mode: :pullup)
      :ok = Lines.fault({chip, 4}, :cut)
      assert_received {:circuits_gpio, _, _, 1}
      assert %{near: 1, far: 0, fault: :cut, open?: true} = Lines.describe({chip, 4})
      :ok = Lines.clear({chip, 4})
      assert_received {:circuits_gpio, _, _, 0}
      :ok = Lines.fault({chip, 4}, {:short, 1})
      assert_received {:circuits_gpio, _, _, 1}
    end

    test "of noise makes as many edges as its rate", %{robot: robot, chip: chip} do
      listen!(chip, 4)
      :ok = Lines.fault({chip, 4}, {:storm, 1000})
      :ok = Stepped.advance(robot, 100 * @ms)
      assert count_edges() == 100
      :ok = Lines.clear({chip, 4})
      count_edges()
      :ok = Stepped.advance(robot, 100 * @ms)
      assert count_edges() == 0
    end

    test "at no line is an error", %{chip: chip} do
      assert Lines.fault({"gpiochip-none", 1}, :cut) == {:error, :not_found}
      assert_raise ArgumentError, fn -> Lines.fault({chip, 1}, :sad) end
    end
  end

  describe "a contact" do
    test "bounces and comes to rest", %{robot: robot, chip: chip} do
      bouncing = [pins: [contact: 4], bounce_ns: 2 * @ms, bounces: 3]
      :ok = Lines.plug(chip, :bumper, {Contact, bouncing})
      listen!(chip, 4, pull_mode: :pullup)
      :ok = Lines.tell(chip, :bumper, :press)
      :ok = Lines.tell(chip, :bumper, :press)
      :ok = Stepped.advance(robot, 2 * @ms)
      assert count_edges() == 7
      assert Lines.level({chip, 4}) == 0
    end

    test "that is normally closed opens when it is pressed", %{chip: chip} do
      :ok = Lines.plug(chip, :stop, {Contact, pins: [contact: 4], normally: :closed})
      {:ok, line} = GPIO.open({chip, 4}, :input, pull_mode: :pullup)
      assert GPIO.read(line) == 0
      :ok = Lines.tell(chip, :stop, :press)
      assert GPIO.read(line) == 1
      :ok = Lines.tell(chip, :stop, :release)
      assert GPIO.read(line) == 0
    end
  end

  test "wrong options of a chip are refused" do
    assert_raise ArgumentError, ~r/expected chips:/, fn -> Lines.start_link(buses: %{}) end
    Process.flag(:trap_exit, true)
    assert {:error, {:shutdown, _}} = Lines.start_link(chips: %{"gpiochip-wrong" => [line: 3]})
  end

  defp count_edges(count \\ 0) do
    receive do
      {:circuits_gpio, _spec, _time_ns, _level} -> count_edges(count + 1)
    after
      0 -> count
    end
  end
end

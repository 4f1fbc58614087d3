defmodule BB.Bus.I2CTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually

  alias BB.Bus.{I2C, Sim}

  doctest BB.Bus.I2C

  # A backend that sends each opening, each closing and each read to the test of its bus.
  defmodule Watched do
    def open(name, opts) do
      tell(name, {:opened, opts})
      with {:ok, bus} <- Sim.I2C.open(name, opts), do: {:ok, {name, bus}}
    end

    def close({name, bus}) do
      tell(name, :closed)
      Sim.I2C.close(bus)
    end

    def read({name, bus}, address, count, opts) do
      tell(name, {:read, address})
      Sim.I2C.read(bus, address, count, opts)
    end

    def write({_name, bus}, address, data, opts), do: Sim.I2C.write(bus, address, data, opts)

    def write_read({_name, bus}, address, data, count, opts),
      do: Sim.I2C.write_read(bus, address, data, count, opts)

    def device_present?({_name, bus}, address), do: Sim.I2C.device_present?(bus, address)

    defp tell(name, what), do: send(:persistent_term.get({__MODULE__, name}), {:backend, what})
  end

  # Keeps the byte that was written last.
  defmodule Cell do
    @behaviour Sim.Device

    @impl true
    def init(opts, _now_ns), do: {:ok, opts[:byte]}

    @impl true
    def write(<<byte>>, _now_ns, _byte), do: {:ok, byte}
    def write(_more, _now_ns, byte), do: {:nak, byte}

    @impl true
    def read(count, _now_ns, byte), do: {:ok, :binary.copy(<<byte>>, count), byte}
  end

  setup do
    name = "i2c-shared-#{System.unique_integer([:positive])}"
    :persistent_term.put({Watched, name}, self())
    on_exit(fn -> :persistent_term.erase({Watched, name}) end)
    start_bus(name)
    %{name: name}
  end

  defp start_bus(name) do
    devices = %{0x10 => {Cell, byte: 1}, 0x11 => {Cell, byte: 2}, 0x12 => {Cell, byte: 3}}
    start_supervised!({Sim, buses: %{name => [devices: devices]}})
  end

  defp open!(name, opts \\ []) do
    {:ok, bus} = I2C.open(name, [backend: Watched] ++ opts)
    bus
  end

  # A stepped clock, so that a bus that is down stays down until the test advances the time.
  defp stepped(%{name: name}) do
    robot = Module.concat(__MODULE__, name)
    start_supervised!({BB.Clock.Stepped, robot: robot}, id: robot)
    {BB.Clock.of(robot), fn ms -> BB.Clock.Stepped.advance(robot, ms * 1_000_000) end}
  end

  defp health(name), do: Enum.find(I2C.health(), &(&1.bus == name))

  # The messages of the backend so far.
  defp told(found \\ []) do
    receive do
      {:backend, what} -> told([what | found])
    after
      0 -> Enum.reverse(found)
    end
  end

  defp opens, do: Enum.count(told(), &match?({:opened, _}, &1))

  # Makes the bus stuck, and waits until its process has closed it.
  defp bring_down(name, bus) do
    :ok = Sim.stuck(name)
    assert I2C.read(bus, 0x10, 1) == {:error, :timeout}
    assert I2C.read(bus, 0x11, 1) == {:error, :timeout}
    assert health(name).state == :down
    told()
  end

  describe "the module" do
    test "that is given is called directly" do
      assert I2C.module(Some.Bus) == Some.Bus
    end

    test "without an option is the shared bus, on the host with the simulated backend" do
      assert I2C.module(nil) == I2C
      assert I2C.backend() == Sim.I2C
    end

    test "has the functions that a driver uses of Circuits.I2C" do
      BB.Test.Circuits.assert_i2c(I2C)
    end
  end

  describe "a handle" do
    test "reaches the devices", %{name: name} do
      bus = open!(name)
      assert I2C.write(bus, 0x10, [7]) == :ok
      assert I2C.read(bus, 0x10, 2) == {:ok, <<7, 7>>}
      assert I2C.write_read(bus, 0x11, <<9>>, 1) == {:ok, <<9>>}
      assert I2C.read(bus, 0x42, 1) == {:error, :i2c_nak}
      assert I2C.detect_devices(bus) == [0x10, 0x11, 0x12]
    end

    test "needs a bus" do
      assert I2C.open("i2c-none") == {:error, :bus_not_found}
      assert I2C.detect_devices("i2c-none") == {:error, :bus_not_found}
    end

    test "has its own retries", %{name: name} do
      stubborn = open!(name, retries: 2)
      :ok = Sim.fault(name, 0x10, {:nak, 2})
      assert I2C.read(stubborn, 0x10, 1) == {:ok, <<1>>}
      :ok = Sim.fault(name, 0x10, {:nak, 1})
      assert I2C.read(stubborn, 0x10, 1, retries: 0) == {:error, :i2c_nak}
    end

    test "that is closed is closed for all its users, and other handles are not", %{name: name} do
      {one, other} = {open!(name), open!(name)}
      assert I2C.close(one) == :ok
      assert I2C.close(one) == :ok

      assert Task.await(Task.async(fn -> I2C.read(one, 0x10, 1) end), :infinity) ==
               {:error, {:errno, 9}}

      assert I2C.read(other, 0x10, 1) == {:ok, <<1>>}
    end

    test "closes with the process that opened it", %{name: name} do
      keep = open!(name)
      test = self()

      owner =
        spawn(fn ->
          send(test, {:bus, open!(name)})
          Process.sleep(:infinity)
        end)

      assert_receive {:bus, bus}
      assert health(name).handles == 2
      assert I2C.read(bus, 0x10, 1) == {:ok, <<1>>}
      Process.exit(owner, :kill)
      assert eventually(fn -> health(name).handles == 1 end)
      assert I2C.read(bus, 0x10, 1) == {:error, {:errno, 9}}
      assert I2C.read(keep, 0x10, 1) == {:ok, <<1>>}
    end

    test "gets the wrong arguments raised where they were given", %{name: name} do
      bus = open!(name)
      BB.Test.Circuits.assert_i2c_raises(I2C, name, bus)
      assert_raise UndefinedFunctionError, fn -> I2C.open(name, backend: No.Such.Bus) end
      assert I2C.read(bus, 0x10, 1) == {:ok, <<1>>}
    end
  end

  describe "the shared process" do
    test "opens the backend once for all, and ends with its last handle", %{name: name} do
      [one, two, three] = for _ <- 1..3, do: open!(name)
      assert one.pid == two.pid and two.pid == three.pid
      monitor = Process.monitor(one.pid)
      I2C.close(one)
      I2C.close(two)
      assert I2C.read(three, 0x10, 1) == {:ok, <<1>>}
      I2C.close(three)
      assert_receive {:DOWN, ^monitor, :process, _pid, :normal}
      assert [{:opened, _}, {:read, 0x10}, :closed] = told()
      assert eventually(fn -> health(name) == nil end)
      assert I2C.read(one, 0x10, 1) == {:error, {:errno, 9}}
    end

    test "is started again for a caller that opens the bus while it ends", %{name: name} do
      for _ <- 1..200 do
        bus = open!(name)
        assert I2C.read(bus, 0x10, 1) == {:ok, <<1>>}
        I2C.close(bus)
      end
    end

    test "of a bus that is missing ends at once", %{name: name} do
      stop_supervised!({Sim, [name]})
      assert I2C.open(name, backend: Watched) == {:error, :bus_not_found}
      assert eventually(fn -> health(name) == nil end)
      start_bus(name)
      assert {:ok, _bus} = I2C.open(name, backend: Watched)
    end

    test "opens with the smallest timeout of its handles, within 20 to 50 ms", %{name: name} do
      open!(name)
      assert [{:opened, timeout: 50}] = told()
      open!(name, timeout: 1000)
      assert [] = told()
      open!(name, timeout: 30)
      assert [:closed, {:opened, timeout: 30}] = told()
      bus = open!(name, timeout: 5)
      assert [:closed, {:opened, timeout: 20}] = told()
      open!(name, timeout: 50)
      assert [] = told()
      assert I2C.read(bus, 0x10, 1) == {:ok, <<1>>}
    end

    test "makes transfers in the order in which they come", %{name: name} do
      bus = open!(name)
      told()
      :sys.suspend(bus.pid)

      waiting =
        for address <- [0x12, 0x10, 0x11, 0x10, 0x12] do
          task = Task.async(fn -> I2C.read(bus, address, 1) end)
          assert eventually(fn -> waits?(task.pid) end)
          task
        end

      :sys.resume(bus.pid)
      assert Task.await_many(waiting, :infinity) == for(n <- [3, 1, 2, 1, 3], do: {:ok, <<n>>})
      assert told() == for(address <- [0x12, 0x10, 0x11, 0x10, 0x12], do: {:read, address})
    end

    defp waits?(pid),
      do: match?({:current_function, {:gen, _, _}}, Process.info(pid, :current_function))

    test "lets a sensor wait for one transfer of another at most", %{name: name} do
      bus = open!(name)
      told()
      :sys.suspend(bus.pid)
      greedy = Task.async(fn -> for _ <- 1..3, do: I2C.read(bus, 0x10, 1) end)
      assert eventually(fn -> waits?(greedy.pid) end)
      modest = Task.async(fn -> I2C.read(bus, 0x11, 1) end)
      assert eventually(fn -> waits?(modest.pid) end)
      :sys.resume(bus.pid)
      Task.await_many([greedy, modest], :infinity)
      assert told() == for(address <- [0x10, 0x11, 0x10, 0x10], do: {:read, address})
    end
  end

  describe "one device that always times out" do
    test "leaves the bus to its siblings", %{name: name} do
      bus = open!(name, timeout: 20)
      :ok = Sim.fault(name, 0x10, :timeout)

      bad = Task.async(fn -> for _ <- 1..10, do: I2C.read(bus, 0x10, 1) end)
      good = Task.async(fn -> for _ <- 1..10, do: I2C.read(bus, 0x11, 1) end)

      assert Task.await(good, :infinity) == for(_ <- 1..10, do: {:ok, <<2>>})
      assert Task.await(bad, :infinity) == for(_ <- 1..10, do: {:error, :timeout})
      assert opens() == 1
      assert %{state: :up, reopened: 0} = health(name)
    end

    test "leaves it also when there are two of them", %{name: name} do
      bus = open!(name, timeout: 20)

      for address <- [0x10, 0x11] do
        :ok = Sim.fault(name, address, :timeout)
        assert I2C.read(bus, address, 1) == {:error, :timeout}
        assert I2C.read(bus, 0x12, 1) == {:ok, <<3>>}
      end

      for _ <- 1..3, address <- [0x10, 0x11], do: I2C.read(bus, address, 1)
      assert I2C.read(bus, 0x12, 1) == {:ok, <<3>>}
      assert opens() == 1
    end
  end

  describe "a bus that is stuck" do
    test "is closed and fails at once for all, and is opened once when its time has come",
         %{name: name} = context do
      {clock, pass_ms} = stepped(context)
      bus = open!(name, timeout: 20, clock: clock)
      told()
      :ok = Sim.stuck(name)
      assert I2C.read(bus, 0x10, 1) == {:error, :timeout}
      assert I2C.read(bus, 0x11, 1) == {:error, :timeout}
      assert told() == [{:read, 0x10}, {:read, 0x11}, :closed]

      for delay_ms <- [10, 20, 40, 80, 100, 100] do
        pass_ms.(delay_ms - 1)
        assert calls_of_many(bus) == [{:error, :timeout}]
        assert told() == []

        pass_ms.(1)
        assert calls_of_many(bus) == [{:error, :timeout}]
        assert [{:opened, _} | tried] = told()
        assert {reads, [{:read, second}, :closed]} = Enum.split(tried, -2)
        assert [{:read, first}] = Enum.uniq(reads)
        assert first != second
        assert health(name).state == :down
      end

      assert %{state: :down, error: :timeout, reopened: 6} = health(name)
    end

    # The answers of many sensors that call at once, each once more.
    defp calls_of_many(bus) do
      for(_ <- 1..10, address <- [0x10, 0x11], do: address)
      |> Enum.map(fn address -> Task.async(fn -> I2C.read(bus, address, 1) end) end)
      |> Task.await_many(:infinity)
      |> Enum.uniq()
    end

    test "is up with the first answer after it was released", %{name: name} = context do
      {clock, pass_ms} = stepped(context)
      bus = open!(name, timeout: 20, clock: clock)
      bring_down(name, bus)
      :ok = Sim.release(name)
      assert I2C.read(bus, 0x12, 1) == {:error, :timeout}
      pass_ms.(10)
      assert I2C.read(bus, 0x12, 1) == {:ok, <<3>>}
      assert %{state: :up, error: nil, reopened: 1} = health(name)
      assert [{:opened, _}, {:read, 0x12}] = told()
    end

    test "recovers within 100 ms of its release, however long it was stuck", context do
      %{name: name} = context
      {clock, pass_ms} = stepped(context)
      bus = open!(name, timeout: 20, clock: clock)
      bring_down(name, bus)

      for _ <- 1..10 do
        pass_ms.(100)
        calls_of_many(bus)
      end

      :ok = Sim.release(name)
      pass_ms.(100)
      assert calls_of_many(bus) == [{:ok, <<1>>}, {:ok, <<2>>}]
    end

    test "can be opened, and is still stuck", %{name: name} = context do
      {clock, _pass_ms} = stepped(context)
      bus = open!(name, timeout: 20, clock: clock)
      bring_down(name, bus)
      late = open!(name, timeout: 20)
      assert late.pid == bus.pid
      assert I2C.read(late, 0x12, 1) == {:error, :timeout}
      assert told() == []
    end

    test "stays known while all of its sensors are between two starts", %{name: name} = context do
      {clock, _pass_ms} = stepped(context)
      bus = open!(name, timeout: 20, clock: clock)
      bring_down(name, bus)
      I2C.close(bus)
      assert eventually(fn -> health(name).handles == 0 end)
      again = open!(name, timeout: 20)
      assert again.pid == bus.pid
      assert I2C.read(again, 0x10, 1) == {:error, :timeout}
      assert told() == []
    end

    test "that is stuck for its only sensor is reopened too", %{name: name} = context do
      {clock, pass_ms} = stepped(context)
      bus = open!(name, timeout: 20, clock: clock)
      :ok = Sim.stuck(name)
      for _ <- 1..3, do: assert(I2C.read(bus, 0x10, 1) == {:error, :timeout})
      assert health(name).state == :down
      :ok = Sim.release(name)
      pass_ms.(10)
      assert I2C.read(bus, 0x10, 1) == {:ok, <<1>>}
    end

    test "logs once that it is down, and once that it is up again", %{name: name} = context do
      {clock, pass_ms} = stepped(context)
      bus = open!(name, timeout: 20, clock: clock)

      log =
        ExUnit.CaptureLog.capture_log(fn ->
          bring_down(name, bus)
          pass_ms.(10)
          calls_of_many(bus)
          :ok = Sim.release(name)
          pass_ms.(20)
          assert I2C.read(bus, 0x10, 1) == {:ok, <<1>>}
        end)

      assert length(String.split(log, "bus #{name} closed")) == 2
      assert length(String.split(log, "bus #{name} is up again")) == 2
    end
  end

  describe "a bus whose adapter is unplugged" do
    test "is found again when it is back", %{name: name} = context do
      {clock, pass_ms} = stepped(context)
      bus = open!(name, timeout: 20, clock: clock)
      stop_supervised!({Sim, [name]})
      assert I2C.read(bus, 0x10, 1) == {:error, {:errno, 19}}
      assert I2C.read(bus, 0x10, 1) == {:error, {:errno, 19}}
      pass_ms.(10)
      assert I2C.read(bus, 0x10, 1) == {:error, :bus_not_found}
      assert I2C.open(name, backend: Watched) == {:error, :bus_not_found}

      start_bus(name)
      pass_ms.(20)
      assert I2C.read(bus, 0x10, 1) == {:ok, <<1>>}
      assert health(name).state == :up
    end
  end

  test "health lists the buses that are open", %{name: name} do
    assert health(name) == nil
    bus = open!(name)

    assert health(name) ==
             %{bus: name, backend: Watched, state: :up, error: nil, reopened: 0, handles: 1}

    I2C.close(bus)
    assert eventually(fn -> health(name) == nil end)
  end
end

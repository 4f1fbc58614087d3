defmodule BB.Sensor.Mpu6050Test do
  use ExUnit.Case, async: true

  import BB.Test.Bench, only: [between_readings: 2, reason_of_end: 1]

  alias BB.Bus.Sim
  alias BB.Bus.Sim.{I2C, Motion}
  alias BB.Message.Sensor.Imu
  alias BB.Sensor.Mpu6050
  alias BB.Sensor.Mpu6050.Registers

  doctest BB.Sensor.Mpu6050

  @recording Path.expand("../../../../shared/data/imu/recording.csv", __DIR__)
  @patience_ms 60_000

  # The bus's clock advances by 5 ms with each reading, and stands still otherwise.
  defmodule SteppedI2C do
    def open(name, opts) do
      with {:ok, bus} <- I2C.open(name, opts),
           do: {:ok, {bus, :persistent_term.get({__MODULE__, name})}}
    end

    def close({bus, _clock}), do: I2C.close(bus)
    def write({bus, _clock}, address, data), do: I2C.write(bus, address, data)

    def write_read({bus, clock}, address, data, count) do
      if count == 18, do: :counters.add(clock, 1, 5_000_000)
      I2C.write_read(bus, address, data, count)
    end
  end

  setup context do
    unique = System.unique_integer([:positive])
    robot = Module.concat(__MODULE__, "Robot#{unique}")
    start_supervised!({BB.PubSub, robot})
    {:ok, _} = BB.PubSub.subscribe(robot, [:sensor])

    name = "i2c-mpu-#{unique}"
    device = {Sim.Mpu6050, Map.get(context, :device, [])}
    start_supervised!({Sim, buses: %{name => [devices: %{0x68 => device}]}})
    %{robot: robot, name: name}
  end

  defp sensor(%{robot: robot, name: name}, opts \\ []) do
    {path, opts} = Keyword.pop(opts, :path, [:base_link, :imu])

    [__callback_module__: Mpu6050, bb: %{robot: robot, path: path}] ++
      Keyword.merge([bus: name], opts)
  end

  # Puts another chip in the place of the test's.
  defp plug(context, opts) do
    :ok = Sim.unplug(context.name, 0x68)
    :ok = Sim.plug(context.name, 0x68, {Sim.Mpu6050, opts})
  end

  # The raw value of the temperature is 0.
  defp felt(acceleration, angular_velocity \\ {0.0, 0.0, 0.0}),
    do: %{acceleration: acceleration, angular_velocity: angular_velocity, temperature: 36.53}

  defp start!(args) do
    id = args[:bb].path

    start_supervised!(
      Supervisor.child_spec({BB.Sensor.Server, args}, id: id, restart: :temporary)
    )
  end

  defp start(args),
    do: start_supervised(Supervisor.child_spec({BB.Sensor.Server, args}, restart: :temporary))

  defp receive_imu do
    assert_receive {:bb, [:sensor, :base_link, :imu], %BB.Message{payload: %Imu{}} = message},
                   @patience_ms

    message
  end

  defp assert_imu(imu, sample, accel_range, gyro_range) do
    assert_vector(
      imu.linear_acceleration,
      sample.acceleration,
      Registers.acceleration_lsb(accel_range)
    )

    assert_vector(
      imu.angular_velocity,
      sample.angular_velocity,
      Registers.angular_velocity_lsb(gyro_range)
    )
  end

  defp assert_vector(%{x: a, y: b, z: c}, {x, y, z}, step) do
    for {got, wanted} <- [{a, x}, {b, y}, {c, z}], do: assert_in_delta(got, wanted, step)
  end

  describe "a message" do
    test "is an Imu with the sensor's name as frame, at its path", context do
      before_ns = System.monotonic_time(:nanosecond)
      start!(sensor(context))
      message = receive_imu()
      assert message.frame_id == :imu
      assert message.robot == context.robot
      assert message.monotonic_time in before_ns..System.monotonic_time(:nanosecond)
    end

    test "does not pretend to know the orientation", context do
      start!(sensor(context))
      imu = receive_imu().payload
      assert imu.orientation == BB.Math.Quaternion.identity()
      assert BB.Math.Covariance3.unavailable?(imu.orientation_covariance)
      assert imu.angular_velocity_covariance == nil
      assert imu.linear_acceleration_covariance == nil
    end

    test "has the frame of the option", context do
      start!(sensor(context, frame_id: :imu_optical))
      assert receive_imu().frame_id == :imu_optical
    end

    for {accel_range, gyro_range} <- [{2, 250}, {4, 500}, {8, 1000}, {16, 2000}] do
      test "is in m/s² and rad/s at ±#{accel_range} g and ±#{gyro_range} °/s", context do
        sample = felt({1.5, -9.0, 12.0}, {0.5, -4.0, 0.001})
        plug(context, source: {:stepped, [sample]})

        start!(
          sensor(context, accel_range: unquote(accel_range), gyro_range: unquote(gyro_range))
        )

        assert_imu(receive_imu().payload, sample, unquote(accel_range), unquote(gyro_range))
      end
    end
  end

  describe "the chip" do
    test "gets exactly the settings that the options ask for", context do
      start!(sensor(context, rate: 200, filter: 94, gyro_range: 1000, accel_range: 8))
      receive_imu()
      {:ok, bus} = I2C.open(context.name)

      {:ok, <<config::binary-size(0x3A - 0x19), _::binary>>} =
        I2C.write_read(bus, 0x68, <<0x19>>, 0x40)

      assert config == <<4, 2, 0x10, 0x10, 0::size(0x37 - 0x1D)-unit(8), 0x10, 0, 0>>
      assert I2C.write_read(bus, 0x68, <<0x6B>>, 2) == {:ok, <<0x01, 0x00>>}
    end

    test "is read in one transfer a message", context do
      pid = start!(sensor(context, rate: 1000))
      receive_imu()

      %{0x68 => %{transfers: before}} = between_readings(pid, fn -> Sim.devices(context.name) end)

      for _ <- 1..20, do: receive_imu()
      :ok = :sys.suspend(pid)
      %{0x68 => %{transfers: later}} = Sim.devices(context.name)
      assert later - before == 20 + pending()
    end

    defp pending,
      do: Process.info(self(), :messages) |> elem(1) |> Enum.count(&match?({:bb, _, _}, &1))

    test "with readings of zero is published", context do
      plug(context, source: {:stepped, [felt({0.0, 0.0, 0.0})]})
      start!(sensor(context))
      assert %{linear_acceleration: %{z: +0.0}} = receive_imu().payload
    end
  end

  describe "the samples" do
    if File.exists?(@recording) do
      # The test sends the ticks. Those of the loop can come at any time.
      test "are those of the recording within one step of the range, none left out or doubled",
           context do
        recording = BB.Bus.Sim.Recording.load!(@recording)
        plug(context, source: {:stepped, recording})
        pid = start!(sensor(context, rate: 4, accel_range: 2, gyro_range: 500))
        assert BB.Bus.Sim.Recording.size(recording) == 7000
        [first | others] = BB.Bus.Sim.Recording.samples(recording)
        assert_imu(receive_imu().payload, first, 2, 500)
        for _ <- others, do: send(pid, :tick)
        for sample <- others, do: assert_imu(receive_imu().payload, sample, 2, 500)
      end
    else
      @tag skip: "the recording #{Path.relative_to_cwd(@recording)} is not there"
      test "are those of the recording within one step of the range, none left out or doubled"
    end

    test "at 200 Hz are those of every 5 ms", context do
      clock = :counters.new(1, [])
      name = context.name <> "-stepped"
      :persistent_term.put({SteppedI2C, name}, clock)
      on_exit(fn -> :persistent_term.erase({SteppedI2C, name}) end)

      device = {Sim.Mpu6050, source: :motion, reset_ms: 0}

      start_supervised!(
        {Sim,
         buses: %{name => [devices: %{0x68 => device}, clock: fn -> :counters.get(clock, 1) end]}}
      )

      start!(
        sensor(context, bus: name, i2c: SteppedI2C, rate: 200, accel_range: 2, gyro_range: 250)
      )

      for n <- 1..200, do: assert_imu(receive_imu().payload, Motion.at(n * 0.005), 2, 250)
    end

    test "of two sensors on one bus do not mix", context do
      plug(context, source: {:stepped, [felt({0.0, 0.0, 5.0})]})

      :ok =
        Sim.plug(context.name, 0x69, {Sim.Mpu6050, source: {:stepped, [felt({0.0, 0.0, -5.0})]}})

      start!(sensor(context, path: [:left], rate: 500))
      start!(sensor(context, path: [:right], rate: 500, address: 0x69))

      for _ <- 1..50 do
        assert_receive {:bb, [:sensor, :left], %{payload: left}}, @patience_ms
        assert_receive {:bb, [:sensor, :right], %{payload: right}}, @patience_ms
        assert_in_delta left.linear_acceleration.z, 5.0, 0.01
        assert_in_delta right.linear_acceleration.z, -5.0, 0.01
      end
    end
  end

  describe "it does not start" do
    test "without an answer", context do
      :ok = Sim.unplug(context.name, 0x68)
      assert {:error, reason} = start(sensor(context))
      assert reason_within(reason) == {:no_answer, context.name, 0x68}
    end

    test "without its bus", context do
      assert {:error, reason} = start(sensor(context, bus: "i2c-none"))
      assert reason_within(reason) == {:bus_not_found, "i2c-none"}
    end

    @tag device: [who_am_i: 0x19]
    test "with another chip", context do
      assert {:error, reason} = start(sensor(context))
      assert reason_within(reason) == {:wrong_chip, context.name, 0x68, 0x19, 0x68}
    end

    @tag device: [model: :mpu6500]
    test "with another model of its family than the option", context do
      assert {:error, reason} = start(sensor(context, model: :mpu9250))
      assert reason_within(reason) == {:wrong_chip, context.name, 0x68, 0x70, 0x71}
    end

    test "with a FIFO without an interrupt line", context do
      assert {:error, reason} = start(sensor(context, fifo: true))
      assert reason_within(reason) == :fifo_without_interrupt
      assert Mpu6050.explain(:fifo_without_interrupt) =~ "needs interrupt:"
    end

    test "with a chip that holds the bus", context do
      :ok = Sim.fault(context.name, 0x68, :timeout)
      assert {:error, reason} = start(sensor(context))
      assert reason_within(reason) == {:timeout, context.name, 0x68}
    end

    test "with wrong options, and names them", context do
      for {opts, message} <- [
            {[address: 0x70], ":address"},
            {[rate: 3], "expected a frequency of 4 to 1000 hertz"},
            {[rate: 1001], "expected a frequency of 4 to 1000 hertz"},
            {[rate: "fast"], ~s(got: "fast")},
            {[rate: BB.Unit.new!(5, :meter)], "expected a frequency of 4 to 1000 hertz"},
            {[accel_range: 3], ":accel_range"},
            {[gyro_range: 2], ":gyro_range"},
            {[filter: 100], ":filter"},
            {[timeout: 0], ":timeout"},
            {[colour: :red], ":colour"}
          ] do
        assert {:error, reason} = start(sensor(context, opts))
        assert %BB.Options.ValidationError{} = error = reason_within(reason)
        assert Exception.message(error) =~ message
      end
    end

    defp reason_within({reason, {:child, _, _, _, _, _, _, _}}), do: reason

    defp reason_within({{reason, _child}, _spec}) when is_tuple(reason) or is_exception(reason),
      do: reason

    defp reason_within({reason, _child}), do: reason
  end

  describe "a rate" do
    test "may be a unit", context do
      start!(sensor(context, rate: BB.Unit.new!(0.5, :kilohertz)))
      receive_imu()
      {:ok, bus} = I2C.open(context.name)
      assert I2C.write_read(bus, 0x68, <<0x19>>, 1) == {:ok, <<1>>}
    end
  end

  describe "a fault in use" do
    test "of two readings is overcome, and nothing is published for it", context do
      plug(context, source: {:stepped, ruler(1000)})
      start!(sensor(context, rate: 500, accel_range: 16))
      first = shown(receive_imu())
      :ok = Sim.fault(context.name, 0x68, {:nak, 2})

      for n <- 1..100, do: assert(shown(receive_imu()) == first + n)
    end

    # Sample n has n steps of the ±16 g range in x.
    defp ruler(size), do: for(n <- 1..size, do: felt({n * 9.80665 / 2048, 0.0, 9.8}))

    defp shown(message), do: round(message.payload.linear_acceleration.x * 2048 / 9.80665)

    test "that stays ends it after three readings, with the reason, and nothing old is published",
         context do
      for {fault, reason} <- [
            nak: {:no_answer, context.name, 0x68},
            retry: {:bus, context.name, 0x68, :retry},
            timeout: {:timeout, context.name, 0x68}
          ] do
        pid = start!(sensor(context, path: [:base_link, :imu]))
        receive_imu()
        between_readings(pid, fn -> :ok = Sim.fault(context.name, 0x68, fault) end)
        assert reason_of_end(pid) == {:shutdown, reason}
        refute_received {:bb, _, _}
        :ok = Sim.clear(context.name, 0x68)
      end
    end

    test "that is a pulled wire ends it likewise", context do
      pid = start!(sensor(context))
      receive_imu()
      between_readings(pid, fn -> :ok = Sim.unplug(context.name, 0x68) end)
      assert reason_of_end(pid) == {:shutdown, {:no_answer, context.name, 0x68}}
      refute_received {:bb, _, _}
    end

    test "that is a moment without power ends it at once, so that it is set up again", context do
      pid = start!(sensor(context))
      receive_imu()

      between_readings(pid, fn ->
        :ok = Sim.unplug(context.name, 0x68)
        :ok = Sim.replug(context.name, 0x68)
      end)

      assert reason_of_end(pid) == {:shutdown, {:restarted, context.name, 0x68}}
      refute_received {:bb, _, _}
    end

    test "that is a moment without power behind a failed reading does so too", context do
      pid = start!(sensor(context))
      receive_imu()

      between_readings(pid, fn ->
        :ok = Sim.unplug(context.name, 0x68)
        :ok = Sim.replug(context.name, 0x68)
        :ok = Sim.fault(context.name, 0x68, {:nak, 1})
      end)

      assert reason_of_end(pid) == {:shutdown, {:restarted, context.name, 0x68}}
      refute_received {:bb, _, _}
    end

    @tag device: [reset_ms: 60_000]
    test "of a chip that does not keep its settings ends the start", context do
      assert {:error, {{:not_configured, name, 0x68}, _child}} = start(sensor(context))
      assert name == context.name
      refute_received {:bb, _, _}
    end
  end

  describe "stopping" do
    test "needs no force while the bus hangs, and gives the bus back", context do
      pid = start!(sensor(context, timeout: 20))
      receive_imu()
      :ok = Sim.fault(context.name, 0x68, :timeout)
      monitor = Process.monitor(pid)
      :ok = stop_supervised([:base_link, :imu])
      assert_receive {:DOWN, ^monitor, :process, ^pid, :shutdown}
    end
  end

  describe "new options" do
    test "set the chip up again", context do
      opts = validated(sensor(context, rate: 100))
      {:ok, sensor} = Mpu6050.init(opts)
      assert {:ok, sensor} = Mpu6050.handle_options(Keyword.put(opts, :filter, 5), sensor)
      {:ok, bus} = I2C.open(context.name)
      assert I2C.write_read(bus, 0x68, <<0x1A>>, 1) == {:ok, <<6>>}
      Mpu6050.terminate(:normal, sensor)
    end

    test "that fail end it with the reason", context do
      opts = validated(sensor(context))
      {:ok, sensor} = Mpu6050.init(opts)
      opts = Keyword.put(opts, :address, 0x69)
      assert Mpu6050.handle_options(opts, sensor) == {:stop, {:no_answer, context.name, 0x69}}
    end

    defp validated(args) do
      {own, opts} = Keyword.split(args, [:__callback_module__, :bb])
      {:ok, opts} = BB.Options.validate(opts, Mpu6050.options_schema())
      [bb: own[:bb]] ++ opts
    end
  end
end

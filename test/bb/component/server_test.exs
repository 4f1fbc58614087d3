defmodule BB.Component.ServerTest do
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Robot

  alias BB.Component
  alias BB.Sensor.SensorProfile
  alias BB.Test.Probe

  doctest BB.Component
  doctest BB.Component.Resolution

  setup do
    robot =
      robot do
        topology do
          link :base do
            sensor :imu, {BB.Test.Probe, rate: 7}

            joint :elbow do
              type :fixed
              sensor :encoder, BB.Test.Probe
              link :arm
            end
          end
        end
      end

    %{robot: robot}
  end

  defp script(robot, callbacks), do: Probe.script(robot, :imu, callbacks)
  defp server(robot), do: BB.Process.whereis(robot, :imu)

  # A robot whose sensor :imu sends the test {:init, opts, pid}, and whose init returns `result`.
  defp started(robot, init, callbacks \\ []) do
    test = self()

    script(robot, [
      {:init,
       fn opts ->
         send(test, {:init, opts, self()})
         init
       end}
      | callbacks
    ])

    start_supervised!(robot)
    assert_receive {:init, opts, pid}
    %{opts: opts, pid: pid}
  end

  # A callback that sends the test its arguments, and returns the result of `fun`.
  defp telling(name, fun) do
    test = self()

    case name do
      :handle_call ->
        fn request, from, state ->
          send(test, {name, request, state})
          fun.(from, state)
        end

      _ ->
        fn argument, state ->
          send(test, {name, argument, state})
          fun.(state)
        end
    end
  end

  describe "init" do
    test "receives the options with defaults and opts[:bb], which is exactly robot and path", %{
      robot: robot
    } do
      %{opts: opts} = started(robot, {:ok, :s})
      assert opts[:rate] == 7
      assert opts[:bb] == %{robot: robot, path: [:base, :imu]}
      assert Keyword.keys(opts) |> Enum.sort() == [:bb, :rate, :sensor_profile]
    end

    test "receives a sensor profile with the joint of the sensor", %{robot: robot} do
      test = self()

      Probe.script(robot, :encoder,
        init: fn opts ->
          send(test, {:encoder, opts[:sensor_profile]})
          {:ok, nil}
        end
      )

      %{opts: opts} = started(robot, {:ok, :s})
      assert opts[:sensor_profile] == %SensorProfile{joint_name: nil, transmission: nil}
      assert_receive {:encoder, %SensorProfile{joint_name: :elbow, transmission: nil}}
    end

    test "{:ok, state} is the user's state in the server's", %{robot: robot} do
      %{pid: pid} = started(robot, {:ok, :mine})
      assert %Component.Server{user_state: :mine} = :sys.get_state(pid)
      assert server(robot) == pid
    end

    test "{:ok, state, timeout} sends :timeout", %{robot: robot} do
      started(robot, {:ok, :s, 1}, handle_info: telling(:handle_info, &{:noreply, &1}))
      assert_receive {:handle_info, :timeout, :s}
    end

    test "{:ok, state, :hibernate} hibernates", %{robot: robot} do
      %{pid: pid} = started(robot, {:ok, :s, :hibernate})
      assert_hibernates(pid)
    end

    test "{:ok, state, {:continue, term}} continues before any message", %{robot: robot} do
      started(robot, {:ok, :s, {:continue, :more}},
        handle_continue: telling(:handle_continue, fn _ -> {:noreply, :continued} end),
        handle_call: telling(:handle_call, fn _from, state -> {:reply, state, state} end)
      )

      assert BB.call(robot, :imu, :state) == :continued
      assert_received {:handle_continue, :more, :s}
    end

    test ":ignore turns the sensor off; it is not restarted", %{robot: robot} do
      %{pid: pid} = started(robot, :ignore)
      assert gone?(pid)
      assert eventually(fn -> health(robot, :imu).state == :ignored end)
      assert %{pid: nil, restarts: 0, retry_in_ms: nil} = health(robot, :imu)
      assert server(robot) == :undefined
      assert [{:imu, :undefined, _, _}] = Supervisor.which_children(keeper(robot, :imu))
      refute_receive {:init, _, _}, 300
    end
  end

  describe "the return value of a callback:" do
    defp called(robot, fun, more \\ []) do
      started(robot, {:ok, :s}, [{:handle_call, telling(:handle_call, fun)} | more])
    end

    test "{:reply, reply, state}", %{robot: robot} do
      %{pid: pid} = called(robot, fn _from, :s -> {:reply, :pong, :t} end)
      assert BB.call(robot, :imu, :ping) == :pong
      assert :sys.get_state(pid).user_state == :t
    end

    test "{:reply, reply, state, timeout}", %{robot: robot} do
      called(robot, fn _from, :s -> {:reply, :pong, :t, 1} end,
        handle_info: telling(:handle_info, &{:noreply, &1})
      )

      assert BB.call(robot, :imu, :ping) == :pong
      assert_receive {:handle_info, :timeout, :t}
    end

    test "{:reply, reply, state, :hibernate}", %{robot: robot} do
      %{pid: pid} = called(robot, fn _from, state -> {:reply, :pong, state, :hibernate} end)
      assert BB.call(robot, :imu, :ping) == :pong
      assert_hibernates(pid)
    end

    test "{:reply, reply, state, {:continue, term}}", %{robot: robot} do
      called(robot, fn _from, state -> {:reply, :pong, state, {:continue, 1}} end,
        handle_continue: telling(:handle_continue, &{:noreply, &1})
      )

      assert BB.call(robot, :imu, :ping) == :pong
      assert_receive {:handle_continue, 1, :s}
    end

    test "{:noreply, state} to a call, with a reply later", %{robot: robot} do
      called(robot, fn from, state ->
        GenServer.reply(from, :later)
        {:noreply, state}
      end)

      assert BB.call(robot, :imu, :ping) == :later
    end

    test "{:stop, reason, reply, state} and {:stop, reason, state} run terminate", %{robot: robot} do
      test = self()
      terminate = fn reason, state -> send(test, {:terminated, reason, state}) end

      called(robot, fn _from, state -> {:stop, :enough, :bye, state} end, terminate: terminate)
      assert BB.call(robot, :imu, :ping) == :bye
      assert_receive {:terminated, :enough, :s}

      script(robot, handle_call: fn _, _, state -> {:stop, :again, state} end)
      assert_receive {:init, _, _}
      assert {:again, _} = catch_exit(BB.call(robot, :imu, :ping))
      assert_receive {:terminated, :again, :s}
    end

    test "{:noreply, …} of handle_cast, handle_info and handle_continue, in all its forms",
         %{robot: robot} do
      %{pid: pid} =
        started(robot, {:ok, 0},
          handle_cast: fn
            :timeout, n -> {:noreply, n + 1, 1}
            :hibernate, n -> {:noreply, n + 1, :hibernate}
            {:continue, next}, n -> {:noreply, n + 1, {:continue, next}}
          end,
          handle_info: telling(:handle_info, &{:noreply, &1 + 10, {:continue, :from_info}}),
          handle_continue: telling(:handle_continue, &{:noreply, &1 + 100, :infinity})
        )

      BB.cast(robot, :imu, {:continue, :from_cast})
      assert_receive {:handle_continue, :from_cast, 1}
      BB.cast(robot, :imu, :timeout)
      assert_receive {:handle_info, :timeout, 102}
      assert_receive {:handle_continue, :from_info, 112}
      assert BB.send(robot, :imu, :hello) == :ok
      assert_receive {:handle_info, :hello, 212}
      BB.cast(robot, :imu, :hibernate)
      assert_hibernates(pid)
    end

    test "any other value is a crash, as in GenServer", %{robot: robot} do
      called(robot, fn _from, _state -> :nonsense end)
      assert {{:bad_return_value, :nonsense}, _} = catch_exit(BB.call(robot, :imu, :ping))
    end
  end

  describe "defaults" do
    test "reply {:error, :not_implemented} to a call, and ignore casts and messages", %{
      robot: robot
    } do
      start_supervised!(robot)
      assert BB.call(robot, :imu, :anything) == {:error, :not_implemented}
      pid = server(robot)
      assert BB.cast(robot, :imu, :anything) == :ok
      BB.send(robot, :imu, :anything)
      assert BB.call(robot, :imu, :anything) == {:error, :not_implemented}
      assert server(robot) == pid
    end
  end

  describe "a server without a keeper" do
    defp start_alone(robot, opts \\ []) do
      [__callback_module__: Probe, bb: %{robot: robot, path: [:base, :imu]}]
      |> Keyword.merge(opts)
      |> BB.Sensor.Server.start_link()
    end

    setup do
      Process.flag(:trap_exit, true)
      :ok
    end

    test "has run init when start_link returns", %{robot: robot} do
      assert {:ok, pid} = start_alone(robot)
      assert :sys.get_state(pid).user_state == %{robot: robot, path: [:base, :imu]}
    end

    test "returns the result of init", %{robot: robot} do
      script(robot, init: fn _ -> {:stop, :no_device} end)
      assert start_alone(robot) == {:error, :no_device}
      script(robot, init: fn _ -> :ignore end)
      assert start_alone(robot) == :ignore
    end

    test "refuses wrong options with the validation error", %{robot: robot} do
      assert {:error, %BB.Options.ValidationError{} = error} = start_alone(robot, rate: 0)

      assert Exception.message(error) ==
               "invalid value for :rate option: expected positive integer, got: 0 (in options [:base, :imu])"
    end

    test "is registered when its robot's registry runs", %{robot: robot} do
      start_supervised!({Registry, keys: :unique, name: BB.Process.registry_name(robot)})
      {:ok, pid} = start_alone(robot)
      assert server(robot) == pid
    end

    test "runs terminate when its supervisor stops it", %{robot: robot} do
      test = self()
      script(robot, terminate: fn reason, _ -> send(test, {:terminated, reason}) end)
      args = [__callback_module__: Probe, bb: %{robot: robot, path: [:base, :imu]}]
      start_supervised!({BB.Sensor.Server, args})
      stop_supervised!({BB.Sensor.Server, [:base, :imu]})
      assert_received {:terminated, :shutdown}
    end

    test "goes down with a linked process, and keeps the time-out when that exits normally",
         %{robot: robot} do
      test = self()

      script(robot,
        init: fn _ -> {:ok, :s} end,
        handle_cast: fn
          :normal, s ->
            spawn_link(fn -> :ok end)
            {:noreply, s, 50}

          :crash, s ->
            spawn_link(fn -> exit(:helper_failed) end)
            {:noreply, s}
        end,
        handle_info: fn message, s ->
          send(test, {:info, message})
          {:noreply, s}
        end
      )

      {:ok, pid} = start_alone(robot)
      GenServer.cast(pid, :normal)
      assert_receive {:info, :timeout}
      GenServer.cast(pid, :crash)
      assert_receive {:EXIT, ^pid, :helper_failed}
      refute_received {:info, _}
    end

    test "leaves exits to a callback module that traps them", %{robot: robot} do
      test = self()

      script(robot,
        init: fn _ ->
          Process.flag(:trap_exit, true)
          {:ok, spawn_link(fn -> exit(:helper_failed) end)}
        end,
        handle_info: fn message, helper ->
          send(test, {:info, message, helper})
          {:noreply, helper}
        end
      )

      {:ok, _pid} = start_alone(robot)
      assert_receive {:info, {:EXIT, helper, :helper_failed}, helper}
    end
  end

  test "the init of a sensor is a telemetry span", %{robot: robot} do
    test = self()
    id = {__MODULE__, robot}

    handler = fn event, _measurements, metadata, _config ->
      if metadata.robot == robot, do: send(test, {event, metadata})
    end

    BB.Telemetry.attach_many(
      id,
      [[:bb, :sensor, :init, :start], [:bb, :sensor, :init, :stop]],
      handler,
      nil
    )

    on_exit(fn -> BB.Telemetry.detach(id) end)
    start_supervised!(robot)
    assert_receive {[:bb, :sensor, :init, :start], %{path: [:base, :imu], module: Probe}}
    assert_receive {[:bb, :sensor, :init, :stop], %{path: [:base, :imu]}}
  end

  defp assert_hibernates(pid) do
    assert eventually(fn ->
             {:current_function, {_module, function, _arity}} =
               Process.info(pid, :current_function)

             function in [:hibernate, :loop_hibernate]
           end)
  end

  defp gone?(pid) do
    ref = Process.monitor(pid)
    assert_receive {:DOWN, ^ref, _, _, _}
    true
  end
end

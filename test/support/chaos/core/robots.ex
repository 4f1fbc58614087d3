defmodule BB.Test.Chaos.Core.Robots do
  @moduledoc """
  The robots of `bin/chaos core`: `Inside`, a child of the application, and `Outside`, a child of
  the harness.

  Both have sensors on a simulated bus, counters, a native process with its topic, a caliper with
  a `disarm/1`, a watchdog that vouches, and parameters that are saved on disk.
  """

  alias BB.Test.Chaos.Core.Watchdog
  alias BB.Test.Run

  @inside BB.Test.Chaos.Core.Inside
  @outside BB.Test.Chaos.Core.Outside
  @bus "i2c-chaos-core"
  @tuned [:p1, :p2, :p3, :p4]

  @doc "Returns the robot that the application supervises."
  def inside, do: @inside

  @doc "Returns the robot that the harness supervises."
  def outside, do: @outside

  @doc "Returns both robots."
  def all, do: [@inside, @outside]

  @doc "Returns the paths of the parameters that are set and saved."
  def tuned, do: for(name <- @tuned, do: [:tune, name])

  @doc "Returns the simulated buses of the robots."
  def buses, do: %{@bus => [devices: %{0x68 => imu(), 0x69 => imu()}]}

  defp imu, do: {BB.Bus.Sim.Mpu6050, source: :motion}

  @doc """
  Tells whether a process may restart because of ends that the supervision tree does not relate to
  it.

  Its keeper restarts it, or, if it is the process of a shared bus, the next process that opens
  the bus.

    * A component, the robot's runtime and its supervisor of tasks have their names in the robot's
      registry.
    * A sensor on the bus needs the processes of the bus, and so does the process that shares the
      bus. These have their names in registries as well.
    * The process that shares a bus ends when all of its users have ended (`BB.Bus.I2C.Server`).
    * A warden serves a robot until the robot has ended; the next robot gets another warden.
  """
  @spec due?([term()], MapSet.t([term()]), [[term()]]) :: boolean()
  def due?(place, ended, all),
    do: dependent?(place, ended) or (shared_bus?(place) and deserted?(ended, all))

  @doc """
  Tells whether a process may restart some time after the ends of others.

  A component detects late that its bus or its program has ended: the program has a grace period.
  Its successor may find the topic taken, or the device reset, and is restarted once more. The
  process of a shared bus follows its sensors.
  """
  @spec late?([term()], MapSet.t([term()]), [[term()]]) :: boolean()
  def late?(place, ended, all),
    do: (component?(place) or shared_bus?(place)) and (place in ended or due?(place, ended, all))

  defp dependent?(place, ended), do: Enum.any?(ended, &depends?(place, &1))

  defp deserted?(ended, all) do
    users = Enum.filter(all, &(component?(&1) and on_the_bus?(&1)))
    users != [] and Enum.all?(users, &(&1 in ended or dependent?(&1, ended)))
  end

  defp shared_bus?(place), do: match?([_server, BB.Bus.I2C.Servers | _], Enum.reverse(place))

  defp depends?(place, other) do
    (registered?(place) and registry(place) in other) or
      (on_the_bus?(place) and Enum.any?(other, &bus?/1)) or
      (warden_of(place) != nil and warden_of(place) == List.last(other))
  end

  defp registered?(place),
    do: component?(place) or List.last(place) == BB.Robot.Runtime or tasks?(place)

  # The bulkhead lives. The supervisor in it may spend its restarts until the registry is back.
  defp tasks?(place), do: Enum.count(place, &(&1 == BB.Supervisor.Tasks)) == 2

  defp component?(place),
    do: match?([name, {kind, name} | _] when kind in [:sensor, :actuator], Enum.reverse(place))

  defp registry(place),
    do: Enum.find_value(all(), &if(&1 in place, do: Module.concat(&1, Registry)))

  defp warden_of(place),
    do: Enum.find(all(), &(List.last(place) == Module.concat(&1, Safety)))

  defp on_the_bus?(place) do
    case Enum.reverse(place) do
      [:imu | _] -> component?(place)
      [_server, BB.Bus.I2C.Servers | _] -> true
      [bus, {BB.Bus.Sim, _buses} | _] -> is_binary(bus)
      _other -> false
    end
  end

  defp bus?(id), do: inspect(id) =~ "BB.Bus."

  @doc "Makes the modules of both robots."
  def define(folder) do
    for {robot, address} <- [{@inside, 0x68}, {@outside, 0x69}],
        do: define(robot, address, folder)
  end

  defp define(robot, address, folder) do
    label = robot |> Module.split() |> List.last() |> String.downcase()
    path = Path.join(folder, label <> ".log")
    frames = Run.unique(label <> ".frames")
    imu = Run.unique(label <> ".imu")

    code =
      quote do
        use BB

        settings do
          parameter_store {BB.Parameter.Store.Log, path: unquote(path)}
        end

        parameters do
          group :tune do
            for name <- unquote(@tuned), do: param(name, type: :integer, default: 0)
          end

          param :rate, type: :integer, default: 1
        end

        sensors do
          sensor :count_1, BB.Test.Counter

          sensor :imu_outlet, {
            BB.Handoff.Outlet,
            from: [:sensor, :base, :imu], topic: unquote(imu), encoding: BB.Handoff.Encoding.Imu
          }
        end

        topology do
          link :base do
            sensor :imu,
                   {BB.Sensor.Mpu6050,
                    bus: unquote(@bus), address: unquote(address), rate: ~u(100 hertz)},
                   max_silence: ~u(500 millisecond)

            sensor :count_2, BB.Test.Counter

            joint :arm do
              type :fixed
              actuator :caliper, {BB.Test.Caliper, force: 10}

              link :hand do
                sensor :count_3, BB.Test.Counter
                sensor :watchdog, unquote(Watchdog)

                sensor :camera,
                       {BB.Sensor.NativeProcess,
                        program: "camera",
                        topics: [topic: unquote(frames)],
                        args: ["--rate", "10", "--width", "320", "--height", "240"]}
              end
            end
          end
        end
      end

    {:module, ^robot, _, _} = Module.create(robot, code, Macro.Env.location(__ENV__))
    robot
  end
end

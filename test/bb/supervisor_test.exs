defmodule BB.SupervisorTest do
  use ExUnit.Case, async: true

  import BB.Test.Robot

  defp probe_robot do
    robot do
      topology do
        link :base do
          sensor :imu, BB.Test.Probe
        end
      end
    end
  end

  describe "the tree" do
    test "holds the robot's sensors, its link, that link's sensors and joints, and so on" do
      robot =
        robot do
          sensors do
            sensor :battery, BB.Test.Probe
          end

          topology do
            link :base do
              sensor :imu, BB.Test.Probe

              joint :elbow do
                type :fixed
                sensor :encoder, BB.Test.Probe

                link :arm do
                  sensor :touch, BB.Test.Probe
                end
              end
            end
          end
        end

      start_supervised!(robot)
      base = [robot, :topology, {:link, :base}]

      assert Enum.sort(for {id, _pid} <- supervisors(robot), do: id) ==
               Enum.sort([
                 [robot],
                 [robot, :topology],
                 [robot, :topology, {:sensor, :battery}],
                 base,
                 base ++ [{:sensor, :imu}],
                 base ++ [{:joint, :elbow}],
                 base ++ [{:joint, :elbow}, {:sensor, :encoder}],
                 base ++ [{:joint, :elbow}, {:link, :arm}],
                 base ++ [{:joint, :elbow}, {:link, :arm}, {:sensor, :touch}]
               ])

      assert Process.whereis(robot)

      for name <- [:battery, :imu, :encoder, :touch],
          do: assert(is_pid(BB.Process.whereis(robot, name)))
    end
  end

  test "a robot comes up" do
    robot = probe_robot()
    start_supervised!(robot)
    assert BB.call(robot, :imu, :x) == {:error, :not_implemented}
    assert %{state: :up, restarts: 0} = health(robot, :imu)
  end
end

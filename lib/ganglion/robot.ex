defmodule Ganglion.Robot do
  @moduledoc """
  The robot that ships: an inertial measurement unit, and a camera with a tag detector.

  `bin/demo` runs it on a simulated bus; a board runs it from boot unless its configuration names
  another robot.

      {:ok, _pid} = Ganglion.Robot.start_link()
      {:ok, _} = BB.subscribe(Ganglion.Robot, [:sensor, :base_link, :imu])

  | sensor | what | publishes |
  |---|---|---|
  | `:imu` | MPU-6050 on `i2c-1` | `[:sensor, :base_link, :imu]`, `BB.Message.Sensor.Imu` at 100 Hz |
  | `:camera` | native process | ring topic `camera`: frames |
  | `:tags` | native process | ring topic `tags`: detections |
  | `:imu_outlet` | pubsub → ring | ring topic `imu` |
  | `:tags_inlet` | ring → pubsub | `[:sensor, :base_link, :camera_mount, :camera_link, :tags]`, `BB.Message.Vision.TagDetections` |

  `config :ganglion, camera_args: [...]` passes arguments to the camera program (`camera --help`).
  """

  use BB

  alias BB.Handoff.Encoding
  alias BB.Handoff.{Inlet, Outlet}
  alias BB.Sensor.{Mpu6050, NativeProcess}

  @imu_path [:sensor, :base_link, :imu]
  @tags_path [:sensor, :base_link, :camera_mount, :camera_link, :tags]

  settings do
    name :ganglion
  end

  sensors do
    sensor :imu_outlet, {Outlet, from: @imu_path, topic: "imu", encoding: Encoding.Imu}

    sensor :tags_inlet,
           {Inlet, topic: "tags", encoding: Encoding.TagDetections, to: @tags_path}
  end

  topology do
    link :base_link do
      sensor :imu, {Mpu6050, bus: "i2c-1", address: 0x68, rate: ~u(100 hertz)},
        required: true,
        max_silence: ~u(100 millisecond)

      joint :camera_mount do
        type :fixed

        origin do
          z ~u(0.1 meter)
        end

        link :camera_link do
          sensor :camera,
                 {NativeProcess,
                  program: "camera",
                  topics: [topic: "camera"],
                  args: {__MODULE__, :camera_args, []}}

          sensor :tags,
                 {NativeProcess,
                  program: "vision_tags",
                  topics: [frames: "camera", imu: "imu", detections: "tags"]}
        end
      end
    end
  end

  # For machines without an I2C bus.
  simulation do
    i2c "i2c-1" do
      device 0x68, {BB.Bus.Sim.Mpu6050, source: :motion}
    end
  end

  @doc false
  def camera_args, do: Application.get_env(:ganglion, :camera_args, [])
end

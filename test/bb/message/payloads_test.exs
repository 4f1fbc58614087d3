defmodule BB.Message.PayloadsTest do
  use ExUnit.Case, async: true

  alias BB.Math.{Quaternion, Transform, Vec3}
  alias BB.Message
  alias BB.Message.{Actuator, Estimator, Geometry, Sensor}
  alias BB.Message.Actuator.Command
  alias BB.Message.Vision.{TagDetection, TagDetections}
  alias BB.Parameter.Changed

  doctest BB.Message.Actuator.BeginMotion
  doctest BB.Message.Actuator.Command.Effort
  doctest BB.Message.Actuator.Command.Hold
  doctest BB.Message.Actuator.Command.Position
  doctest BB.Message.Actuator.Command.Stop
  doctest BB.Message.Actuator.Command.Trajectory
  doctest BB.Message.Actuator.Command.Velocity
  doctest BB.Message.Actuator.EndMotion
  doctest BB.Message.Estimator.Odometry
  doctest BB.Message.Estimator.Pose
  doctest BB.Message.Firmware.RoundTrip
  doctest BB.Message.Geometry.Accel
  doctest BB.Message.Geometry.Point3D
  doctest BB.Message.Geometry.Pose
  doctest BB.Message.Geometry.Twist
  doctest BB.Message.Geometry.Twist2D
  doctest BB.Message.Geometry.Wrench
  doctest BB.Message.Geometry.Wrench2D
  doctest BB.Message.Network.Connection
  doctest BB.Message.Network.Operator
  doctest BB.Message.Sensor.BatteryState
  doctest BB.Message.Sensor.Contact
  doctest BB.Message.Sensor.Image
  doctest BB.Message.Sensor.Imu
  doctest BB.Message.Sensor.JointState
  doctest BB.Message.Sensor.LaserScan
  doctest BB.Message.Sensor.PowerState
  doctest BB.Message.Sensor.Range
  doctest BB.Message.Sensor.Status
  doctest BB.Message.System.Status
  doctest BB.Message.Vision.TagDetection
  doctest BB.Message.Vision.TagDetections

  @detection %TagDetection{
    family: "tag36h11",
    id: 7,
    hamming: 0,
    decision_margin: 80.5,
    centre: {10.0, 20.0},
    corners: [{9.0, 19.0}, {11.0, 19.0}, {11.0, 21.0}, {9.0, 21.0}]
  }

  # Each payload with its required fields and the defaults of the others.
  @payloads [
    {Sensor.Imu,
     [
       orientation: Quaternion.identity(),
       angular_velocity: Vec3.zero(),
       linear_acceleration: Vec3.zero()
     ],
     [
       orientation_covariance: nil,
       angular_velocity_covariance: nil,
       linear_acceleration_covariance: nil
     ]},
    {Sensor.PowerState, [voltage: 7.4, current: -0.1], [power: nil, shunt_voltage: nil]},
    {Sensor.BatteryState, [voltage: 7.4],
     [
       current: 0.0,
       charge: 0.0,
       capacity: 0.0,
       percentage: nil,
       power_supply_status: :unknown,
       power_supply_health: :unknown,
       present: true
     ]},
    {BB.Message.System.Status,
     [
       memory_total: 1024,
       memory_available: 512,
       load_1_min: 0.1,
       load_5_min: 0.2,
       load_15_min: 0.3,
       processors: 4
     ], [temperature: nil, throttling: nil, throttled_before: nil]},
    {Sensor.Range,
     [
       radiation_type: :ultrasound,
       field_of_view: 0.2,
       min_range: 0.02,
       max_range: 4.0,
       range: 1.0
     ], []},
    {Sensor.LaserScan,
     [
       angle_min: -1.0,
       angle_max: 1.0,
       angle_increment: 0.5,
       time_increment: 0.0,
       scan_time: 0.1,
       range_min: 0.1,
       range_max: 12.0,
       ranges: [1.0, 2.0]
     ], [intensities: []]},
    {Sensor.Image, [height: 2, width: 2, step: 2, encoding: :mono8, data: <<1, 2, 3, 4>>],
     [is_bigendian: false]},
    {Sensor.JointState, [names: [:elbow]], [positions: [], velocities: [], efforts: []]},
    {Sensor.Contact, [pressed: true], []},
    {Sensor.Status, [state: :up], [reason: nil, restarts: 0, retry_in_ms: nil]},
    {Geometry.Pose, [transform: Transform.identity()], []},
    {Geometry.Point3D, [vec: Vec3.zero()], []},
    {Geometry.Twist, [linear: Vec3.zero(), angular: Vec3.zero()], []},
    {Geometry.Accel, [linear: Vec3.zero(), angular: Vec3.zero()], []},
    {Geometry.Wrench, [force: Vec3.zero(), torque: Vec3.zero()], []},
    {Geometry.Twist2D, [vx: 1.0, vy: 0.0, omega: 0.0], []},
    {Geometry.Wrench2D, [fx: 1.0, fy: 0.0, tau: 0.0], []},
    {Estimator.Pose, [transform: Transform.identity()], [covariance: nil]},
    {Estimator.Odometry,
     [
       pose: Transform.identity(),
       twist: %Geometry.Twist{linear: Vec3.zero(), angular: Vec3.zero()}
     ], [child_frame_id: nil, pose_covariance: nil, twist_covariance: nil]},
    {Actuator.BeginMotion,
     [initial_position: 0.0, target_position: 1.57, expected_arrival: -1_000],
     [command_id: nil, command_type: nil, acceleration: nil, peak_velocity: nil]},
    {Actuator.EndMotion, [position: 1.57, reason: :completed],
     [detail: nil, message: nil, command_id: nil]},
    {Command.Position, [position: 1.57], [velocity: nil, duration: nil, command_id: nil]},
    {Command.Velocity, [velocity: -0.5], [duration: nil, command_id: nil]},
    {Command.Effort, [effort: 2.0], [duration: nil, command_id: nil]},
    {Command.Trajectory,
     [waypoints: [[position: 0.0, velocity: 0.1, acceleration: 0.2, time_from_start: 0]]],
     [repeat: 1, command_id: nil]},
    {Command.Hold, [], [command_id: nil]},
    {Command.Stop, [], [mode: :immediate, command_id: nil]},
    {TagDetections, [frame_sequence: 3, capture_time: -5, detections: [@detection]],
     [camera_frame_id: nil, image_width: nil, image_height: nil, angular_speed: nil]}
  ]

  for {module, required, defaults} <- @payloads do
    describe inspect(module) do
      @module module
      @required required
      @defaults defaults

      test "is made from what it needs, the rest has its defaults" do
        payload = Message.new!(@module, :frame, @required).payload
        assert payload == struct!(@module, @required ++ @defaults)

        assert Enum.sort(Map.keys(Map.from_struct(payload))) ==
                 Enum.sort(Keyword.keys(@required ++ @defaults))
      end

      for {key, _} <- required do
        test "requires #{key}" do
          assert {:error, %{key: unquote(key)} = error} =
                   @module.new(:frame, Keyword.delete(@required, unquote(key)))

          assert Exception.message(error) =~ "required #{inspect(unquote(key))} option not found"
        end
      end
    end
  end

  defp message(module, attrs) do
    {_, required, _} = List.keyfind(@payloads, module, 0)
    assert {:error, error} = Message.new(module, :frame, Keyword.merge(required, attrs))
    Exception.message(error)
  end

  test "a Range may be out of reach" do
    {_, required, _} = List.keyfind(@payloads, Sensor.Range, 0)

    assert {:ok, %{payload: %{range: :infinity}}} =
             Sensor.Range.new(:frame, Keyword.put(required, :range, :infinity))

    assert message(Sensor.Range, range: :far) =~ "expected :infinity, got: :far"
  end

  test "a BatteryState's percentage is from 0 to 1" do
    for p <- [0.0, 1.0, nil],
        do: assert({:ok, _} = Sensor.BatteryState.new(:f, voltage: 1.0, percentage: p))

    for p <- [50.0, -0.1, 1],
        do:
          assert(
            message(Sensor.BatteryState, percentage: p) ==
              "invalid value for :percentage option: expected nil or a float from 0.0 to 1.0, got: #{inspect(p)}"
          )
  end

  test "an Image's sizes are not negative and its encoding is known" do
    assert message(Sensor.Image, step: -1) =~ "expected non negative integer, got: -1"
    assert message(Sensor.Image, encoding: :jpeg) =~ "expected one of [:rgb8, "
  end

  test "commands and motions refuse what they do not know" do
    assert message(Command.Stop, mode: :slowly) =~
             "expected one of [:immediate, :decelerate], got: :slowly"

    assert message(Command.Position, position: 1) =~ "expected float, got: 1"
    assert message(Command.Velocity, duration: 0) =~ "expected"
    assert message(Actuator.EndMotion, reason: :tired) =~ "expected one of [:completed, "

    assert message(Command.Trajectory, waypoints: [[position: 0.0]]) =~
             "required :time_from_start option not found, received options: [:position]"

    assert message(Command.Trajectory, waypoints: [[time_from_start: 0]]) =~
             "required :position option not found, received options: [:time_from_start]"

    for wrong <- [[velocity: 1], [acceleration: :fast], [time_from_start: -1], [jerk: 1.0]] do
      waypoint = Keyword.merge([position: 0.0, time_from_start: 0], wrong)

      assert message(Command.Trajectory, waypoints: [waypoint]) =~
               inspect(hd(Keyword.keys(wrong)))
    end

    assert message(Command.Trajectory, repeat: 0) =~ "expected"
  end

  test "the rates of a waypoint may be absent, and stay so" do
    waypoints = [
      [position: 0.0, time_from_start: 0],
      [position: 0.5, velocity: nil, time_from_start: 5],
      [position: 1.0, acceleration: 2.0, time_from_start: 10]
    ]

    payload =
      Message.new!(Command.Trajectory, :arm, waypoints: waypoints, repeat: :forever).payload

    assert Enum.map(payload.waypoints, &Enum.sort/1) == Enum.map(waypoints, &Enum.sort/1)
  end

  test "a command's id is a reference, or nil" do
    id = make_ref()

    for {module, required, defaults} <- @payloads, Keyword.has_key?(defaults, :command_id) do
      for command_id <- [nil, id] do
        attrs = Keyword.put(required, :command_id, command_id)
        assert Message.new!(module, :arm, attrs).payload.command_id == command_id
      end

      assert message(module, command_id: 1) =~ "command_id"
    end
  end

  test "a parameter's change has a source, :local where it is not given" do
    for {attrs, source} <- [{[], :local}, {[source: :remote], :remote}] do
      changed = Message.new!(Changed, :parameter, [path: [:a], new_value: 1] ++ attrs).payload
      assert changed == %Changed{path: [:a], old_value: nil, new_value: 1, source: source}
    end

    assert {:error, %{key: :source}} =
             Message.new(Changed, :parameter, path: [:a], new_value: 1, source: :moon)
  end

  test "estimates have covariances of six" do
    covariance = BB.Math.Covariance6.identity()

    assert {:ok, %{payload: %{covariance: ^covariance}}} =
             Estimator.Pose.new(:f, transform: Transform.identity(), covariance: covariance)

    assert message(Estimator.Odometry, pose_covariance: BB.Math.Covariance3.zero()) =~ "expected"
  end

  test "a wrong element of a JointState is reported by its place" do
    assert message(Sensor.JointState, positions: [0.0, 1]) ==
             "invalid value for :positions option: expected element 1 to be a float, BB.Math.Transform2D.t() or BB.Math.Transform.t(), got: 1"

    assert message(Sensor.JointState, names: ["elbow"]) ==
             "invalid value for :names option: expected element 0 to be an atom, got: \"elbow\""

    assert message(Sensor.JointState, efforts: 1.0) ==
             "invalid value for :efforts option: expected a list, each element a float, " <>
               "BB.Message.Geometry.Wrench2D.t() or BB.Message.Geometry.Wrench.t(), got: 1.0"

    assert message(Sensor.JointState, velocities: [1.0 | 2.0]) =~
             "expected a list, each element a float"
  end

  test "a JointState takes transforms, twists and wrenches" do
    twist = %Geometry.Twist2D{vx: 1.0, vy: 0.0, omega: 0.1}
    wrench = %Geometry.Wrench{force: Vec3.zero(), torque: Vec3.zero()}

    assert {:ok,
            %{
              payload: %{positions: [%Transform{}, 0.5], velocities: [^twist], efforts: [^wrench]}
            }} =
             Sensor.JointState.new(:frame,
               names: [:a, :b],
               positions: [Transform.identity(), 0.5],
               velocities: [twist],
               efforts: [wrench]
             )

    assert message(Sensor.JointState, positions: [twist]) =~ "expected element 0 to be a float, "
  end

  test "Geometry is made by position too" do
    {a, b, motion} = {Vec3.new(1, 2, 3), Vec3.new(4, 5, 6), Transform.identity()}

    for {made, payload} <- [
          {Geometry.Pose.new(:f, motion), %Geometry.Pose{transform: motion}},
          {Geometry.Point3D.new(:f, a), %Geometry.Point3D{vec: a}},
          {Geometry.Twist.new(:f, a, b), %Geometry.Twist{linear: a, angular: b}},
          {Geometry.Accel.new(:f, a, b), %Geometry.Accel{linear: a, angular: b}},
          {Geometry.Wrench.new(:f, a, b), %Geometry.Wrench{force: a, torque: b}},
          {Geometry.Twist2D.new(:f, 1.0, 2.0, 3.0),
           %Geometry.Twist2D{vx: 1.0, vy: 2.0, omega: 3.0}},
          {Geometry.Wrench2D.new(:f, 1.0, 2.0, 3.0),
           %Geometry.Wrench2D{fx: 1.0, fy: 2.0, tau: 3.0}}
        ] do
      assert {:ok, %Message{frame_id: :f, payload: ^payload}} = made
    end

    assert {:error, %{key: :transform}} = Geometry.Pose.new(:f, transform: a)
  end

  test "numbers become the floats of a motion in the plane; its attributes are floats" do
    assert {:ok, %{payload: %{vx: vx, vy: vy, omega: omega}}} = Geometry.Twist2D.new(:f, 1, 2, 3)
    assert {vx, vy, omega} === {1.0, 2.0, 3.0}
    assert {:ok, %{payload: %{fx: fx, fy: fy, tau: tau}}} = Geometry.Wrench2D.new(:f, 1, 2, 3)
    assert {fx, fy, tau} === {1.0, 2.0, 3.0}
    assert {:error, %{key: :vx}} = Geometry.Twist2D.new(:f, vx: 1, vy: 2.0, omega: 3.0)
    assert {:error, %{key: :tau}} = Geometry.Wrench2D.new(:f, fx: 1.0, fy: 2.0, tau: 3)

    for module <- [Geometry.Twist2D, Geometry.Wrench2D],
        do: assert_raise(FunctionClauseError, fn -> module.new(:f, "1", 2, 3) end)
  end

  test "a Pose is made of its parts, and has them" do
    position = Vec3.new(1, 2, 3)
    orientation = Quaternion.new(1, 2, 3, 4)
    assert {:ok, %{frame_id: :f, payload: pose}} = Geometry.Pose.new(:f, position, orientation)
    assert Geometry.Pose.position(pose) == position
    assert Geometry.Pose.to_transform(pose) == pose.transform
    assert Geometry.Pose.new(:f, pose.transform) |> elem(1) |> Map.get(:payload) == pose
    assert {:ok, %{payload: ^pose}} = Geometry.Pose.new(:f, transform: pose.transform)

    for key <- [:w, :x, :y, :z] do
      assert_in_delta Map.get(Geometry.Pose.orientation(pose), key),
                      Map.get(orientation, key),
                      1.0e-12
    end
  end

  test "a Point3D has its coordinates" do
    {:ok, %{payload: point}} = Geometry.Point3D.new(:f, Vec3.new(1, 2, 3))
    alias Geometry.Point3D
    assert {Point3D.x(point), Point3D.y(point), Point3D.z(point)} === {1.0, 2.0, 3.0}
    assert Point3D.to_vec3(point) == Vec3.new(1, 2, 3)
  end

  test "a LaserScan's ranges are floats" do
    assert message(Sensor.LaserScan, ranges: [1.0, 2]) =~
             "invalid list in :ranges option: invalid value for list element at position 1: expected float, got: 2"
  end

  test "TagDetections are structs of their own" do
    assert message(TagDetections, detections: [%{id: 1}]) =~
             "expected BB.Message.Vision.TagDetection, got: %{id: 1}"
  end
end

defmodule BB.ApiTest do
  @moduledoc """
  The names that code for Beam Bots uses: the functions, macros, callbacks and struct fields of
  each module. Other tests hold what they do; this one fails with the name that is gone.
  """

  use ExUnit.Case, async: true

  @commands BB.Message.Actuator.Command

  # Each module: its functions, and its macros, callbacks and fields where it has such. A field
  # is a name, or a name with its default.
  @modules [
    # Units
    {BB.Unit,
     "unit_name/1 validate_unit/1 new/1 new/2 new!/2 convert/2 convert!/2 compare/2 " <>
       "compatible?/2 to_string!/1 to_string!/2", macros: "sigil_u/2", fields: [:name, :value]},
    {BB.Unit.Option, "unit_type/0 unit_type/1 validate/1 validate/2", []},
    {BB.Robot.Units,
     "to_meters/1 to_radians/1 to_kilograms/1 to_kilogram_square_meters/1 to_newtons/1 " <>
       "to_newton/1 to_newton_meters/1 to_meters_per_second/1 to_radians_per_second/1 " <>
       "to_meters_per_square_second/1 to_radians_per_square_second/1 to_linear_damping/1 " <>
       "to_rotational_damping/1 extract_float/1 to_meters_or_nil/1 to_radians_or_nil/1 " <>
       "to_kilograms_or_nil/1 to_kilogram_square_meters_or_nil/1 to_newtons_or_nil/1 " <>
       "to_newton_meters_or_nil/1 to_meters_per_second_or_nil/1 " <>
       "to_radians_per_second_or_nil/1 to_meters_per_square_second_or_nil/1 " <>
       "to_radians_per_square_second_or_nil/1 to_linear_damping_or_nil/1 " <>
       "to_rotational_damping_or_nil/1", []},

    # Loops
    {BB.Loop, "new/2 arm/1 tick/1 observe/2 cancel/1",
     fields: [
       :bb,
       :clock,
       :period_ns,
       :deadline_ns,
       last_ns: nil,
       tick_ref: nil,
       ticks: 0,
       skipped: 0
     ]},

    # Messages
    {BB.Message, "new/3 new!/3 schema/1",
     macros: "__using__/1",
     callbacks: "schema/0",
     fields: [
       :monotonic_time,
       :wall_time,
       :node,
       :frame_id,
       :payload,
       robot: nil,
       arm_epoch: nil
     ]},
    {BB.Message.Option,
     "vec3_type/0 quaternion_type/0 transform_type/0 covariance3_type/0 covariance6_type/0 " <>
       "configurations_type/0 velocities_type/0 efforts_type/0 validate_vec3/2 " <>
       "validate_quaternion/2 validate_transform/2 validate_covariance3/2 " <>
       "validate_covariance6/2 validate_configurations/2 validate_velocities/2 " <>
       "validate_efforts/2", []},
    {BB.Message.Geometry.Pose, "schema/0 new/2 new/3 position/1 orientation/1 to_transform/1",
     fields: [:transform]},
    {BB.Message.Geometry.Point3D, "schema/0 new/2 x/1 y/1 z/1 to_vec3/1", fields: [:vec]},
    {BB.Message.Geometry.Twist, "schema/0 new/2 new/3", fields: [:linear, :angular]},
    {BB.Message.Geometry.Accel, "schema/0 new/2 new/3", fields: [:linear, :angular]},
    {BB.Message.Geometry.Wrench, "schema/0 new/2 new/3", fields: [:force, :torque]},
    {BB.Message.Geometry.Twist2D, "schema/0 new/2 new/4", fields: [:vx, :vy, :omega]},
    {BB.Message.Geometry.Wrench2D, "schema/0 new/2 new/4", fields: [:fx, :fy, :tau]},
    {BB.Message.Sensor.JointState, "schema/0 new/2",
     fields: [:names, :positions, :velocities, :efforts]},
    {BB.Message.Sensor.Imu, "schema/0 new/2",
     fields: [:orientation, :angular_velocity, :linear_acceleration]},
    {BB.Message.Sensor.BatteryState, "schema/0 new/2", fields: [:voltage, :percentage]},
    {BB.Message.Sensor.PowerState, "schema/0 new/2", fields: [:voltage, :current, :power]},
    {BB.Message.Sensor.Range, "schema/0 new/2", fields: [:range]},
    {BB.Message.Sensor.LaserScan, "schema/0 new/2", fields: [:ranges]},
    {BB.Message.Sensor.Image, "schema/0 new/2", fields: [:data, :encoding]},
    {BB.Message.Estimator.Pose, "schema/0 new/2", []},
    {BB.Message.Estimator.Odometry, "schema/0 new/2", []},
    {BB.Message.Actuator.BeginMotion, "schema/0 new/2",
     fields: [
       :initial_position,
       :target_position,
       :expected_arrival,
       :command_id,
       :command_type,
       :acceleration,
       :peak_velocity
     ]},
    {BB.Message.Actuator.EndMotion, "schema/0 new/2", []},
    {Module.concat(@commands, Position), "schema/0 new/2",
     fields: [:position, :velocity, :duration, :command_id]},
    {Module.concat(@commands, Velocity), "schema/0 new/2",
     fields: [:velocity, :duration, :command_id]},
    {Module.concat(@commands, Effort), "schema/0 new/2",
     fields: [:effort, :duration, :command_id]},
    {Module.concat(@commands, Stop), "schema/0 new/2", fields: [:mode, :command_id]},
    {Module.concat(@commands, Hold), "schema/0 new/2", fields: [:command_id]},
    {Module.concat(@commands, Trajectory), "schema/0 new/2",
     fields: [:waypoints, :repeat, :command_id]},
    {BB.StateMachine.Transition, "schema/0 new/2", fields: [:from, :to]},
    {BB.Safety.HardwareError, "schema/0 new/2", fields: [:path, :error]},
    {BB.Parameter.Changed, "schema/0 new/2", fields: [:path, :old_value, :new_value, :source]},
    {BB.Command.Event, "schema/0 new/2", fields: [:status, :data]},

    # The facade and the pubsub
    {BB, "subscribe/2 subscribe/3 unsubscribe/2 publish/3 publish/4 call/3 call/4 cast/3 send/3",
     macros: "__using__/1"},
    {BB.PubSub, "subscribe/2 subscribe/3 unsubscribe/2 publish/3 publish/4", []},

    # Maths
    {BB.Math.Vec3,
     "new/3 zero/0 unit_x/0 unit_y/0 unit_z/0 x/1 y/1 z/1 to_list/1 from_list/1 add/2 " <>
       "subtract/2 negate/1 scale/2 dot/2 cross/2 distance/2 lerp/3 magnitude/1 " <>
       "magnitude_squared/1 normalise/1", fields: [:x, :y, :z]},
    {BB.Math.Quaternion,
     "new/4 identity/0 w/1 x/1 y/1 z/1 multiply/2 conjugate/1 inverse/1 slerp/3 " <>
       "from_axis_angle/2 to_axis_angle/1 from_euler/3 from_euler/4 to_euler/1 to_euler/2 " <>
       "from_two_vectors/2 from_rotation_matrix/1 to_rotation_list/1 rotate_vector/2 " <>
       "angular_distance/2 normalise/1 to_list/1 from_list/1 to_xyzw_list/1 from_xyzw_list/1",
     fields: [:w, :x, :y, :z]},
    {BB.Math.Transform,
     "identity/0 inverse/1 to_list/1 compose/2 compose_all/1 translation/1 " <>
       "get_translation/1 rotation_x/1 rotation_y/1 rotation_z/1 from_axis_angle/2 " <>
       "from_quaternion/1 get_quaternion/1 from_position_quaternion/2 get_rotation_list/1 " <>
       "apply_to_point/2 translation_along/2 from_origin/1 get_right_vector/1 " <>
       "get_up_vector/1 get_forward_vector/1", fields: [:m]},
    {BB.Math.Transform2D, "new/3 identity/0 compose/2 inverse/1 plane_basis/1 to_transform/2",
     fields: [:x, :y, :theta]},
    {BB.Math.Covariance3, "zero/0 identity/0 diagonal/1 get/3 new/1", []},
    {BB.Math.Covariance6, "zero/0 identity/0 diagonal/1 get/3 new/1", []},

    # Components
    {BB.Options, "new!/1 validate/2 validate!/2 docs/1", fields: [:schema]},
    {BB.Component.OptionsSchema, "validate/3", []},
    {BB.Sensor, "to_joint_space/3 publish_joint_state/3",
     macros: "__using__/1",
     callbacks:
       "init/1 options_schema/0 disarm/1 handle_options/2 handle_call/3 handle_cast/2 " <>
         "handle_info/2 handle_continue/2 terminate/2"},
    {BB.Sensor.Server, "start_link/1 start_link/2", []},
    {BB.Sensor.Mimic, "init/1 options_schema/0 handle_info/2 handle_options/2", []},
    {BB.Sensor.OpenLoopPositionEstimator,
     "init/1 options_schema/0 handle_info/2 handle_call/3 handle_cast/2 handle_options/2", []},
    {BB.Actuator,
     "default_command_payloads/0 set_position/3 set_position/4 set_velocity/3 " <>
       "set_velocity/4 set_effort/3 set_effort/4 follow_trajectory/3 follow_trajectory/4 " <>
       "stop/2 stop/3 hold/2 hold/3 publish_begin_motion/3 to_joint_space/3 " <>
       "set_position_sync/3 set_position_sync/4 set_position_sync/5",
     macros: "__using__/1",
     callbacks:
       "init/1 handle_command/2 disarm/1 options_schema/0 capabilities/1 command_payloads/1 " <>
         "handle_options/2 handle_call/3 handle_cast/2 handle_info/2 handle_continue/2 " <>
         "terminate/2"},
    {BB.Actuator.Server, "start_link/1 start_link/2", []},
    {BB.Actuator.MotorProfile, "from_joint/2",
     fields: [
       motor_lower: nil,
       motor_upper: nil,
       motor_velocity_limit: nil,
       motor_acceleration_limit: nil,
       motor_effort_limit: nil,
       motor_initial_position: 0.0
     ]},
    {BB.Controller, "",
     macros: "__using__/1",
     callbacks:
       "init/1 options_schema/0 disarm/1 handle_options/2 handle_call/3 handle_cast/2 " <>
         "handle_info/2 handle_continue/2 terminate/2"},
    {BB.Controller.Server, "start_link/1 start_link/2", []},
    {BB.Controller.PatternMatch, "init/1 options_schema/0 handle_info/2", []},
    {BB.Controller.Threshold, "init/1 options_schema/0 handle_info/2", []},
    {BB.Controller.Action, "command/1 command/2 handle_event/1 execute/3", []},
    {BB.Controller.Action.Command, "", fields: [:command, args: []]},
    {BB.Controller.Action.Callback, "", fields: [:handler]},
    {BB.Controller.Action.Context, "",
     fields: [:robot_module, :robot, :robot_state, :controller_name]},
    {BB.Process,
     "via/2 whereis/2 registry_name/1 call/3 call/4 cast/3 send/3 child_spec/5 child_spec/6 " <>
       "bridge_child_spec/4", []},
    {BB.Transmission.Resolver, "resolve/3 resolve_and_subscribe/3 handle_change/6", []},
    {BB.Sim.Actuator, "init/1 disarm/1 handle_command/2 options_schema/0", []},
    {BB.Sim.Controller, "init/1 handle_call/3 options_schema/0", []},
    {BB.Sim.Bridge, "init/1", []},

    # Parameters
    {BB.Parameter,
     "get/2 get!/2 set/3 set_many/2 list/1 list/2 implements?/1 register/3 list_remote/2 " <>
       "get_remote/3 set_remote/4 subscribe_remote/3", callbacks: "param_schema/0"},
    {BB.Parameter.Type, "validate/1 option_type/3 validate_bounds/2 describe/1", []},
    {BB.Parameter.Schema, "build_nested_schema/1 flatten_params/1", []},
    {BB.Parameter.Store, "", callbacks: "init/2 load/1 save/3 close/1"},
    {BB.Parameter.Store.Dets, "init/2 load/1 save/3 close/1", []},
    {BB.Parameter.Reference, "param/1", fields: [:path, expected_unit_type: nil]},
    {BB.Dsl.ParamRef, "param/1", []},

    # Safety, diagnostics, errors
    {BB.Safety,
     "armed?/1 state/1 arm/1 disarm/1 disarm/2 force_disarm/1 register/2 report_error/3 " <>
       "in_error?/1 disarming?/1 epoch/1", []},
    {BB.Safety.Controller,
     "armed?/1 state/1 arm/1 disarm/1 disarm/2 force_disarm/1 register/2 report_error/3 " <>
       "in_error?/1 disarming?/1 epoch/1 register_robot/1 register_topology_supervisor/1 " <>
       "registered_handlers/1 transition_to_error/1", []},
    {BB.Diagnostic, "new/1 publish/1 ok/2 ok/3 warn/2 warn/3 error/2 error/3 stale/2 stale/3",
     fields: [:component, :level, :message, :timestamp, values: %{}]},
    {BB.Telemetry, "emit/3 span/3", []},
    {BB.Error, "severity/1 critical?/1", macros: "__using__/1"},
    {BB.Error.Severity, "severity/1", []},
    {BB.Dsl.Error, "exception/1 message/1", fields: [:module, :path, :message]},

    # The robot
    {BB.Robot,
     "root_link/1 get_link/2 get_joint/2 parent_joint/2 child_joints/2 path_to/2 " <>
       "path_between/3 actuator_path/2 links_in_order/1 joints_in_order/1",
     fields: [
       :name,
       :root_link,
       :links,
       :joints,
       :sensors,
       :actuators,
       :topology,
       :param_subscriptions
     ]},
    {BB.Robot.Link, "",
     fields: [
       :name,
       :parent_joint,
       :child_joints,
       :mass,
       :center_of_mass,
       :inertia,
       :visual,
       :collisions,
       :sensors
     ]},
    {BB.Robot.Joint, "rotational?/1 linear?/1 movable?/1 dof/1",
     fields: [
       :name,
       :type,
       :parent_link,
       :child_link,
       :origin,
       :axis,
       :limits,
       :dynamics,
       :sensors,
       :actuators
     ]},
    {BB.Robot.Topology, "depth_of/2 path_to/2 path_between/3 leaf_links/2 max_depth/1",
     fields: [:link_order, :joint_order, :paths, :depth]},
    {BB.Robot.Builder, "build/1", []},
    {BB.Robot.Runtime,
     "get_robot/1 get_robot_state/1 state/1 configurations/1 velocities/1 " <>
       "simulation_mode/1 via/1", []},
    {BB.Robot.State,
     "new/1 get_configuration/2 set_configuration/3 set_configurations/2 get_velocity/2 " <>
       "set_velocity/3 set_velocities/2 get_all_configurations/1 get_all_velocities/1 " <>
       "reset/1 get_chain_configurations/2 get_parameter/2 set_parameter/3", []},

    # The declaration
    {BB.Dsl.Info,
     "topology/1 sensors/1 controllers/1 parameters/1 commands/1 settings/1 " <>
       "settings_name/1 settings_name!/1 settings_registry_module/1 " <>
       "settings_registry_module!/1 settings_registry_options/1 " <>
       "settings_registry_options!/1 settings_supervisor_module/1 " <>
       "settings_supervisor_module!/1 settings_parameter_store/1 " <>
       "settings_parameter_store!/1 settings_topology_max_restarts/1 " <>
       "settings_topology_max_restarts!/1 settings_topology_max_seconds/1 " <>
       "settings_topology_max_seconds!/1 states/1 state_names/1 initial_state/1 " <>
       "categories/1 category_limits/1", []},
    {BB.Dsl.State, "reserved_names/0", fields: [:name, :doc]},
    {BB.Dsl.Link, "",
     fields: [
       :name,
       :visual,
       :inertial,
       joints: [],
       sensors: [],
       estimators: [],
       collisions: []
     ]},
    {BB.Dsl.Joint, "",
     fields: [
       :name,
       :type,
       :origin,
       :axis,
       :link,
       :dynamics,
       :limit,
       sensors: [],
       actuators: []
     ]},
    {BB.Dsl.Sensor, "", fields: [:name, :child_spec, :transmission, estimators: []]},
    {BB.Dsl.Actuator, "", fields: [:name, :child_spec, :transmission]},
    {BB.Dsl.Controller, "", fields: [:name, :child_spec, simulation: :omit]},
    {BB.Dsl.Bridge, "", fields: [:name, :child_spec, simulation: :omit]},
    {BB.Dsl.Origin, "",
     fields:
       Enum.map([:x, :y, :z], &{&1, BB.Unit.new!(0, "meter")}) ++
         Enum.map([:roll, :pitch, :yaw], &{&1, BB.Unit.new!(0, "degree")})},
    {BB.Dsl.Axis, "", fields: Enum.map([:roll, :pitch, :yaw], &{&1, BB.Unit.new!(0, "degree")})},
    {BB.Dsl.Limit, "", fields: [:lower, :upper, :effort, :velocity, :acceleration]},
    {BB.Dsl.Dynamics, "", fields: [:damping, :friction]},
    {BB.Dsl.Transmission, "", fields: [reduction: 1.0, offset: nil, reversed?: false]},
    {BB.Dsl.Visual, "", fields: [:geometry, :material, :origin]},
    {BB.Dsl.Collision, "", fields: [:name, :geometry, :origin]},
    {BB.Dsl.Inertial, "", fields: [:mass, :origin, :inertia]},
    {BB.Dsl.Inertia, "", fields: [:ixx, :iyy, :izz, :ixy, :ixz, :iyz]},
    {BB.Dsl.Box, "", fields: [:x, :y, :z]},
    {BB.Dsl.Cylinder, "", fields: [:radius, :height]},
    {BB.Dsl.Sphere, "", fields: [:radius]},
    {BB.Dsl.Capsule, "", fields: [:radius, :height]},
    {BB.Dsl.Mesh, "", fields: [:filename, scale: 1]},
    {BB.Dsl.Material, "", fields: [:name, :color, :texture]},
    {BB.Dsl.Color, "", fields: [:red, :green, :blue, alpha: 1]},
    {BB.Dsl.Texture, "", fields: [:filename]},
    {BB.Dsl.Param, "", fields: [:name, :type, :default, :min, :max, :doc]},
    {BB.Dsl.ParamGroup, "", fields: [:name, :doc, params: [], groups: []]},
    {BB.Dsl.Estimator, "",
     fields: [
       :name,
       :child_spec,
       :sync_tolerance,
       :latency_budget,
       :lost_after,
       :on_degraded,
       :on_lost,
       :on_recovered,
       inputs: [],
       outputs: [],
       recover_after: 1
     ]},
    {BB.Dsl.Estimator.Input, "", fields: [:name, :path, driver?: false]},
    {BB.Dsl.Estimator.Output, "", fields: [:name, :path]},
    {BB.Dsl.Command, "",
     fields: [
       :name,
       :handler,
       :category,
       timeout: :infinity,
       allowed_states: [:idle],
       cancel: [],
       arm: false,
       disarm: false,
       arguments: []
     ]},
    {BB.Dsl.Command.Argument, "", fields: [:name, :type, :default, :doc, required: false]},
    {BB.Dsl.Category, "", fields: [:name, :doc, concurrency_limit: 1]}
  ]

  for {module, functions, others} <- @modules do
    @module module
    @functions functions
    @others others

    test "#{inspect(module)} has its names" do
      assert {:module, @module} == Code.ensure_loaded(@module)
      assert missing_functions(@module, @functions) == []
      assert missing_macros(@module, @others[:macros] || "") == []
      assert missing_callbacks(@module, @others[:callbacks] || "") == []
      assert missing_fields(@module, @others[:fields] || []) == []
    end
  end

  # Each error: its class, and its fields.
  @errors [
    {Hardware, :hardware,
     BusError: [:bus, :address, :operation, :reason],
     DeviceError: [:device, :error_code, :description],
     Disconnected: [:device, :reason],
     Timeout: [:device, :operation, :timeout_ms]},
    {Invalid, :invalid,
     Command: [:command, :argument, :value, :reason],
     CommandResult: [:command, :value],
     JointConfig: [:joint, :field, :value, :expected, :message],
     Parameter: [:param_path, :value, :reason],
     Topology: [:module, :location, :message]},
    {Invalid.Bridge, :invalid,
     InvalidParamId: [:param_id],
     ReadOnly: [:param_name],
     TorqueMustBeDisabled: [:param_name, :servo_id],
     UnknownParam: [:param_name, :control_table]},
    {State, :state,
     NotArmed: [:robot, :actuator, :command],
     UnsupportedCommand: [:robot, :actuator, :command, :supported],
     StaleEpoch: [:robot, :actuator, :command, :epoch, :current_epoch],
     NotAllowed: [:operation, :current_state, :allowed_states],
     Preempted: [:preempted_operation, :preempting_operation],
     Timeout: [:from_state, :to_state, :timeout_ms],
     CommandCrashed: [:command, :exception]},
    {State, :invalid, Invalid: [:state, :valid_states]},
    {Category, :state, Full: [:category, :limit, :current]},
    {Estimator, :invalid, MissingCovariance: [:estimator, :field]},
    {Estimator, :state,
     StaleInput: [:input_path, :age_ms, :budget_ms],
     SyncMiss: [:driver_path, :input_path, :gap_ms, :tolerance_ms]},
    {Kinematics, :kinematics,
     UnknownLink: [:link, :role, :robot],
     UnknownJoint: [:joint, :robot],
     UnknownActuator: [:actuator, :robot],
     NoParentJoint: [:link],
     NotAnAncestor: [:source_link, :target_link, :common_ancestor],
     NoDofs: [:target_link, :chain_length],
     NoSolution: [:target_link, :target_pose, :iterations, :residual, :positions],
     Unreachable: [:target_link, :target_pose, :reason, :iterations, :residual, :positions],
     Singularity: [:joint_positions, :manipulability, :threshold],
     SelfCollision: [:link_a, :link_b, :joint_positions],
     MultiFailed: [:failed_link, :error, :partial_results]},
    {Safety, :safety,
     CollisionRisk: [:component_path, :collision_type, :details],
     DisarmFailed: [:component_path, :reason, :failures],
     EmergencyStop: [:source, :reason],
     LimitExceeded: [:component_path, :limit_type, :measured_value, :limit_value, :unit]}
  ]

  for {namespace, class, errors} <- @errors, {name, fields} <- errors do
    @error Module.concat([BB.Error, namespace, name])
    @class class
    @fields fields

    test "#{inspect(@error)} has its class, its fields and a severity" do
      assert missing_functions(@error, "exception/1 message/1") == []
      assert missing_fields(@error, @fields) == []
      error = @error.exception(Enum.map(@fields, &{&1, nil}))
      assert %{__struct__: @error, class: @class} = error
      assert is_binary(Exception.message(error))
      assert BB.Error.severity(error) in [:critical, :error, :warning]
    end
  end

  @namespaces ~w(Hardware Invalid Invalid.Bridge Kinematics Protocol Safety State Estimator
                 Category)

  test "the namespaces of the errors are modules" do
    for name <- @namespaces, do: Code.ensure_loaded!(Module.concat(BB.Error, name))
  end

  defmodule Bare do
    use BB
  end

  test "a robot has its names" do
    names =
      "robot/0 start_link/0 start_link/1 child_spec/0 child_spec/1 " <>
        "__bb_parameter_schema__/0 __bb_default_parameters__/0 __bb_states__/0 " <>
        "__bb_state_names__/0 __bb_initial_state__/0 __bb_categories__/0 " <>
        "__bb_category_limits__/0 __bb_arm_command__/0 __bb_disarm_command__/0"

    assert missing_functions(Bare, names) == []
  end

  defmodule BareSensor do
    use BB.Sensor

    @impl BB.Sensor
    def init(opts), do: {:ok, opts}
  end

  defmodule BareActuator do
    use BB.Actuator

    @impl BB.Actuator
    def init(opts), do: {:ok, opts}

    @impl BB.Actuator
    def disarm(_opts), do: :ok

    @impl BB.Actuator
    def handle_command(_message, state), do: {:noreply, state}
  end

  defmodule BareController do
    use BB.Controller

    @impl BB.Controller
    def init(opts), do: {:ok, opts}
  end

  for {driver, kind} <- [
        {BareSensor, BB.Sensor},
        {BareActuator, BB.Actuator},
        {BareController, BB.Controller}
      ] do
    @driver driver
    @kind kind

    test "a bare #{inspect(kind)} has the default callbacks" do
      names =
        "options_schema/0 handle_options/2 handle_call/3 handle_cast/2 handle_info/2 " <>
          "handle_continue/2 terminate/2"

      assert missing_functions(@driver, names) == []
      assert %BB.Options{schema: []} = @driver.options_schema()
      assert @kind in Keyword.fetch!(@driver.module_info(:attributes), :behaviour)
      assert @driver.handle_options([a: 1], :state) == {:ok, :state}

      assert @driver.handle_call(:ping, {self(), make_ref()}, :state) ==
               {:reply, {:error, :not_implemented}, :state}

      assert @driver.handle_cast(:ping, :state) == {:noreply, :state}
      assert @driver.handle_info(:ping, :state) == {:noreply, :state}
      assert @driver.handle_continue(:ping, :state) == {:noreply, :state}
      assert @driver.terminate(:normal, :state) == :ok
    end
  end

  test "a bare actuator has no capabilities, and takes the six commands" do
    assert BareActuator.capabilities([]) == []

    assert BareActuator.command_payloads([]) ==
             for(
               name <- [Effort, Hold, Position, Stop, Trajectory, Velocity],
               do: Module.concat(@commands, name)
             )
  end

  defp missing_functions(module, names) do
    Code.ensure_loaded!(module)

    for {name, arity} <- parse(names),
        not function_exported?(module, name, arity),
        do: {name, arity}
  end

  defp missing_macros(module, names),
    do:
      for(
        {name, arity} <- parse(names),
        not macro_exported?(module, name, arity),
        do: {name, arity}
      )

  defp missing_callbacks(_module, ""), do: []
  defp missing_callbacks(module, names), do: parse(names) -- module.behaviour_info(:callbacks)

  defp missing_fields(_module, []), do: []

  defp missing_fields(module, fields) do
    struct = module.__struct__()
    Enum.reject(fields, &has_field?(struct, &1))
  end

  defp has_field?(struct, {name, default}), do: match?(%{^name => ^default}, struct)
  defp has_field?(struct, name), do: Map.has_key?(struct, name)

  defp parse(names) do
    for name <- String.split(names) do
      [name, arity] = String.split(name, "/")
      {String.to_atom(name), String.to_integer(arity)}
    end
  end
end

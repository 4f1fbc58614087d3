defmodule BB.Process do
  @moduledoc """
  The names of a robot's processes.

  Each component is registered under its name, unique in its robot, while it runs. Use these
  functions to find or call it:

      iex> BB.Process.via(MyRobot, :imu)
      {:via, Registry, {MyRobot.Registry, :imu}}

  With the name, `GenServer.call/3` and the like reach the component.
  """

  alias BB.Process.Name

  @doc "Returns the name of a robot's process registry."
  @spec registry_name(module()) :: module()
  defdelegate registry_name(robot), to: Name

  @doc "Returns a component's name for `GenServer.call/3` and the like."
  @spec via(module(), term()) :: {:via, module(), {module(), term()}}
  defdelegate via(robot, name), to: Name

  @doc """
  Returns the process of a component, or `:undefined` while it is down.

  Raises `ArgumentError` when the robot is not started.
  """
  @spec whereis(module(), term()) :: pid() | :undefined
  def whereis(robot, name),
    do: registry_module(robot).whereis_name({registry_name(robot), name})

  @doc """
  Calls a process of a robot by its name and returns its reply.

  Exits as `GenServer.call/3` does when the process is down or does not reply in time.
  """
  @spec call(module(), term(), term(), timeout()) :: term()
  def call(robot, name, request, timeout \\ 5_000),
    do: GenServer.call(via(robot, name), request, timeout)

  @doc """
  Casts a request to a process of a robot by its name, and returns `:ok`.

  The request is lost while the process is down.
  """
  @spec cast(module(), term(), term()) :: :ok
  def cast(robot, name, request), do: GenServer.cast(via(robot, name), request)

  @doc """
  Sends a message to a process of a robot by its name, and returns `:ok`.

  The message is lost while the process is down.
  """
  @spec send(module(), term(), term()) :: :ok
  def send(robot, name, message) do
    case whereis(robot, name) do
      :undefined ->
        :ok

      pid ->
        _ = Kernel.send(pid, message)
        :ok
    end
  end

  @doc """
  Returns the specification of a component as a child of a supervisor.

  `child` is a module or `{module, options}`, `parent_path` the path of its link or joint, and
  `kind` is `:sensor`, `:actuator` or `:controller`. The process is registered under `name`. With
  `simulation:` in `opts`, an actuator is a simulated one.

      iex> spec = BB.Process.child_spec(MyRobot, :imu, BB.Sensor.Mpu6050, [:base], :sensor)
      iex> {BB.Sensor.Server, :start_link, [args, [name: name]]} = spec.start
      iex> {spec.id, args[:bb].path, name == BB.Process.via(MyRobot, :imu)}
      {:imu, [:base, :imu], true}

  The supervisors of a robot start keepers (`BB.Component.Keeper`) instead, which restart a
  component by themselves.
  """
  @spec child_spec(
          module(),
          atom(),
          module() | {module(), keyword()},
          [atom()],
          :sensor | :actuator | :controller,
          keyword()
        ) :: Supervisor.child_spec()
  def child_spec(robot, name, child, parent_path, kind, opts \\ [])
      when kind in [:sensor, :actuator, :controller] do
    {module, options} = if is_tuple(child), do: child, else: {child, []}
    bb = %{robot: robot, path: parent_path ++ [name]}
    {module, options} = simulated(kind, opts[:simulation], module, options)
    args = [__callback_module__: module, bb: bb] ++ options
    %{id: name, start: {server(kind), :start_link, [args, [name: via(robot, name)]]}}
  end

  @doc """
  Returns the specification of a bridge (`BB.Bridge`) as a child of a supervisor: the bridge's
  module itself is started as a `GenServer`, with the options and `bb:`, under its name.

      iex> spec = BB.Process.bridge_child_spec(MyRobot, :remote, {MyBridge, port: 1}, [])
      iex> {GenServer, :start_link, [MyBridge, args, [name: _name]]} = spec.start
      iex> {spec.id, args[:bb], args[:port]}
      {:remote, %{robot: MyRobot, path: [:remote]}, 1}

  With `simulation:` in `opts` it is a `BB.Sim.Bridge`.
  """
  @spec bridge_child_spec(module(), atom(), module() | {module(), keyword()}, keyword()) ::
          Supervisor.child_spec()
  def bridge_child_spec(robot, name, child, opts \\ []) do
    {module, options} = if is_tuple(child), do: child, else: {child, []}
    {module, options} = simulated(:bridge, opts[:simulation], module, options)
    args = [bb: %{robot: robot, path: [name]}] ++ options
    %{id: name, start: {GenServer, :start_link, [module, args, [name: via(robot, name)]]}}
  end

  # The kinds of components build on this module, which therefore has their names as text only.
  defp server(kind), do: Module.concat(["BB", Macro.camelize("#{kind}"), "Server"])

  defp simulated(:actuator, mode, _module, _options) when mode != nil,
    do: {Module.concat(["BB", "Sim", "Actuator"]), []}

  defp simulated(:bridge, mode, _module, _options) when mode != nil,
    do: {Module.concat(["BB", "Sim", "Bridge"]), []}

  defp simulated(_kind, _mode, module, options), do: {module, options}

  @doc """
  Returns the module of the robot's registry, `Registry` unless its `settings` name another.
  """
  @spec registry_module(module()) :: module()
  defdelegate registry_module(robot), to: Name

  @doc """
  Returns the module of the robot's supervisors, `Supervisor` unless its `settings` name another.
  """
  @spec supervisor_module(module()) :: module()
  def supervisor_module(robot), do: Name.setting(robot, :supervisor_module, Supervisor)

  @doc "Returns the child specification of the registry, for the robot's root supervisor."
  @spec registry_spec(module()) :: Supervisor.module_spec()
  def registry_spec(robot) do
    options = Name.setting(robot, :registry_options, partitions: System.schedulers_online())
    {registry_module(robot), [keys: :unique, name: registry_name(robot)] ++ options}
  end
end

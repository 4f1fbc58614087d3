defmodule BB.Component.Health do
  @moduledoc """
  The health of a robot's components: one row for each component, which any process may read.

  `BB.Sensor.health/1`, `BB.Actuator.health/1` and `BB.Controller.health/1` return these rows.

      [%{name: :imu, state: :up, restarts: 0}] = BB.Sensor.health(MyRobot)

  Each keeper holds its row in the robot's registry, so that a reader waits for no component. A
  component's module is called for the text of an error once for each error, by its keeper, and
  for its rate once for each set of options. A function that did not return in time is not waited
  for again.
  """

  alias BB.Component
  alias BB.Robot.SimulationMode
  alias BB.Component.{PublishRate, Status}

  @typedoc """
  The health of one component:

    * `state` - the component's state (`t:BB.Component.Status.state/0`)
    * `since` - the monotonic time in nanoseconds at which it entered that state
    * `pid` - its process, or `nil` while it is down
    * `restarts` - the number of its restarts since the robot was started
    * `retry_in_ms` - the delay before the next restart, as it was when the component went down
    * `reason` - why it is not up, or `nil`
    * `last_error` - the latest reason why it was not up, kept when it is up again, or the last
      trouble of a component that ran on (`BB.Sensor.trouble/1`); `nil` when there was none
    * `error` - the last error as text, from the component's module
    * `rate_hz` - messages a second on its path, measured over the last sixteen, falling once the
      next is overdue; `nil` before the first message, and for a component that publishes
      elsewhere
    * `declared_hz` - messages a second as the module declares for its options
      (`c:BB.Sensor.rate/1`), or `nil`
    * `age_ns` - the age of its last message, or `nil` before the first
  """
  @type row :: %{
          name: atom(),
          path: [atom()],
          module: module(),
          required: boolean(),
          state: Status.state(),
          pid: pid() | nil,
          restarts: non_neg_integer(),
          reason: term(),
          last_error: term(),
          error: String.t() | nil,
          rate_hz: float() | nil,
          declared_hz: number() | nil,
          age_ns: integer() | nil,
          retry_in_ms: pos_integer() | nil,
          since: integer()
        }

  @doc """
  Returns the rows of all components of a kind, in the order of their declaration.

  Raises `ArgumentError` when the robot is not started.
  """
  @spec list(module(), module()) :: [row()]
  def list(robot, kind) do
    registry = started!(robot)
    module = BB.Process.registry_module(robot)
    components = for %{kind: ^kind} = component <- SimulationMode.components(robot), do: component

    for {component, rates} <- Enum.zip(components, PublishRate.list(robot, components)),
        do: module |> row(registry, component) |> Map.merge(rates)
  end

  @doc """
  Registers the calling keeper's row, for as long as the keeper lives.

  Returns `{:error, pid}` while an earlier keeper, which was killed, has not exited yet.
  """
  @spec register(module(), Component.t(), Status.t(), pid() | nil) :: :ok | {:error, pid()}
  def register(robot, component, status, pid) do
    registry = BB.Process.registry_name(robot)
    module = BB.Process.registry_module(robot)

    case module.register(registry, key(component), to_row(component, status, pid)) do
      {:error, {:already_registered, other}} when other != self() -> {:error, other}
      _registered -> :ok
    end
  end

  @doc "Updates the calling keeper's row."
  @spec put(module(), Component.t(), Status.t(), pid() | nil) :: :ok
  def put(robot, component, status, pid) do
    registry = BB.Process.registry_name(robot)
    module = BB.Process.registry_module(robot)
    row = to_row(component, status, pid)
    _ = module.update_value(registry, key(component), fn _old -> row end)
    summary = {status.restarts, Status.alarm?(status)}
    module.put_meta(registry, {:summary, component.name}, summary)
  rescue
    # The registry is being restarted. The keeper registers its row again.
    ArgumentError -> :ok
  end

  @doc """
  Returns the restarts that a component's earlier keeper counted, and whether it had set an alarm.

  Returns `nil` when the component has had no keeper before.
  """
  @spec previous(module(), Component.t()) :: {non_neg_integer(), boolean()} | nil
  def previous(robot, component) do
    registry = BB.Process.registry_name(robot)

    case BB.Process.registry_module(robot).meta(registry, {:summary, component.name}) do
      {:ok, summary} -> summary
      :error -> nil
    end
  rescue
    ArgumentError -> nil
  end

  defp row(module, registry, component) do
    case module.lookup(registry, key(component)) do
      [{_keeper, row}] -> row
      [] -> to_row(component, Status.new(System.monotonic_time(:nanosecond)), nil)
    end
  end

  defp to_row(component, status, pid) do
    %{
      name: component.name,
      path: component.path,
      module: component.module,
      required: component.required,
      state: status.state,
      pid: pid,
      restarts: status.restarts,
      reason: status.reason,
      last_error: status.last_error,
      error: status.error,
      retry_in_ms: status.retry_in_ms,
      since: status.since_ns
    }
  end

  defp key(component), do: {:keeper, component.name}

  defp started!(robot) do
    registry = BB.Process.registry_name(robot)

    if Process.whereis(registry),
      do: registry,
      else: raise(ArgumentError, not_started(robot))
  end

  defp not_started(robot) do
    "robot #{inspect(robot)} is not started; start it under a supervisor or with " <>
      "#{inspect(robot)}.start_link()"
  end
end

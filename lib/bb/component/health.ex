defmodule BB.Component.Health do
  @moduledoc """
  How a robot's components fare, for anyone to look up. Each keeper holds a row of its own in the robot's registry, so
  nobody waits for anybody. A component's module is asked for its words once for each error, by
  its keeper, and for its rate once for each set of options; one that does not answer is not
  waited for again.
  """

  alias BB.Component
  alias BB.Component.{Status, PublishRate}

  @typedoc """
  One component:

    * `state`, and `since`, the monotonic time in nanoseconds at which it entered that
    * `pid`, `nil` while it is down; `restarts` since the robot was started; `retry_in_ms` as it was when it went down
    * `reason`: why it is not up; `last_error`: the latest such reason, also after it is up again, or what was wrong while it went on (`BB.Sensor.trouble/1`), `nil` when there was none; `error`: the last error in the words of its module
    * `rate_hz`: messages a second on its path, over the last sixteen, falling once the next is overdue; `nil` before the first, and of what publishes elsewhere
    * `declared_hz`: messages a second as the module says for its options (`c:BB.Sensor.rate/1`), `nil` where it does not
    * `age_ns`: how old its last message is, `nil` before the first
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

  @doc "All components of a kind, in the order of their declaration. Raises `ArgumentError` when the robot is not started."
  @spec list(module(), module()) :: [row()]
  def list(robot, kind) do
    registry = started!(robot)
    module = BB.Process.registry_module(robot)
    components = for %{kind: ^kind} = component <- robot.robot().components, do: component

    for {component, pace} <- Enum.zip(components, PublishRate.of(robot, components)),
        do: module |> row(registry, component) |> Map.merge(pace)
  end

  @doc """
  Enters a keeper's row, for as long as the calling process lives. `{:error, pid}` while a keeper that was killed has not ended yet.
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

  @doc "Renews the calling keeper's row."
  @spec put(module(), Component.t(), Status.t(), pid() | nil) :: :ok
  def put(robot, component, status, pid) do
    registry = BB.Process.registry_name(robot)
    module = BB.Process.registry_module(robot)
    row = to_row(component, status, pid)
    _ = module.update_value(registry, key(component), fn _old -> row end)
    left = {status.restarts, Status.alarming?(status)}
    module.put_meta(registry, {:kept, component.name}, left)
  rescue
    # The registry is being restarted; the keeper enters its row again.
    ArgumentError -> :ok
  end

  @doc """
  What a keeper that died has left to the one after it: `{restarts, alarming?}`, `nil` when this one is the first.
  """
  @spec left(module(), Component.t()) :: {non_neg_integer(), boolean()} | nil
  def left(robot, component) do
    case BB.Process.registry_module(robot).meta(
           BB.Process.registry_name(robot),
           {:kept, component.name}
         ) do
      {:ok, left} -> left
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
      else: raise(ArgumentError, "the robot #{inspect(robot)} is not started")
  end
end

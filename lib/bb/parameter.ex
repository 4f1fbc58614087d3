defmodule BB.Parameter do
  @moduledoc """
  Parameters of a robot: named values with a type, bounds and a default, which can be set while
  the robot runs. Use them for what people tune, such as rates, gains and limits.

      defmodule MyRobot do
        use BB

        settings do
          parameter_store {BB.Parameter.Store.Log, path: "/data/params"}
        end

        parameters do
          param :debug, type: :boolean, default: false, doc: "Whether to log each sample."

          group :imu do
            param :rate, type: {:unit, :hertz}, default: ~u(100 hertz), max: ~u(1 kilohertz)
          end
        end

        topology do
          link :base_link do
            sensor :imu, {BB.Sensor.Mpu6050, bus: "i2c-1", rate: param([:imu, :rate])}
          end
        end
      end

      BB.Parameter.set(MyRobot, [:imu, :rate], ~u(200 hertz))

  `BB.Parameter.Type` lists the types. A wrong declaration raises `BB.Dsl.Error` when the robot's
  module is compiled.

  ## Reading

  `get/2` reads an ETS table and calls no process, so it may be called in a loop.

  ## Setting

  `set/3` and `set_many/2` check the values; a wrong value changes nothing. They return when the
  robot's store has saved the values for good (`BB.Parameter.Store`). A value may have any unit
  that converts to the unit of the parameter, and is converted to it.

  Writes run one after the other. Each publishes `BB.Parameter.Changed` on `[:param | path]`, with
  the frame_id `:parameter`, also when the value is the same as before. When the message arrives,
  the value can be read.

  ## Following

  `param([:imu, :rate])` in a robot's declaration follows the parameter: see `BB.Sensor`. Your own
  process subscribes to `[:param, :imu, :rate]`, or to `[:param, :imu]` for the whole group, or
  uses `watch/2`, which returns the current values and sends every later change exactly once.

  ## Origin of the values

  A parameter starts with the default of its declaration, or without a value. The persisted
  value overrides the default, and a value in `start_link(params: [imu: [rate: ~u(50 hertz)]])`
  overrides both. A wrong value in `params:` fails the start. A wrong persisted value is logged
  and dropped, so that no file can prevent the start of a robot. `BB.Parameter.Store` explains
  which values are persisted.

  All functions raise `ArgumentError` when the robot is not started.
  """

  alias BB.Options.ValidationError
  alias BB.Parameter.{Definition, Owner, Reference, Values}

  @typedoc "The names of the groups around a parameter, and its own name: `[:imu, :rate]`."
  @type path :: [atom(), ...]

  @type reason ::
          {:unregistered_parameter, path()} | {:unknown_parameter, atom()} | ValidationError.t()

  @type not_kept :: {:not_kept, term()}

  @doc """
  Returns the parameters of a module for `register/3`, as a schema of `BB.Options`.

  It may also be a keyword list, `[name: [type: …, default: …]]`, with the fields of `param` in a
  robot's declaration, `min` and `max` among them.
  """
  @callback param_schema() :: BB.Options.t() | BB.Options.schema() | BB.Options.spark()

  @doc """
  Returns whether a module has parameters for `register/3`.

      iex> BB.Parameter.implements?(String)
      false
  """
  @spec implements?(module()) :: boolean()
  def implements?(module) do
    is_atom(module) and Code.ensure_loaded?(module) and
      function_exported?(module, :param_schema, 0)
  end

  @doc """
  Returns a parameter's value: `{:ok, value}`, or `{:error, :not_found}`.

  A parameter without a default has no value until it is set.
  """
  @spec get(module(), path()) :: {:ok, term()} | {:error, :not_found}
  def get(robot, path) do
    with :error <- Values.fetch(robot, path), do: {:error, :not_found}
  end

  @doc """
  Returns a parameter's value. Raises `ArgumentError` when the robot has no such parameter, or
  when the parameter has no value.
  """
  @spec get!(module(), path()) :: term()
  def get!(robot, path) do
    case Values.fetch(robot, path) do
      {:ok, value} -> value
      :error -> raise ArgumentError, not_found(robot, path)
    end
  end

  defp not_found(robot, path) do
    case Values.fetch_definition(robot, path) do
      {:ok, _definition} ->
        "parameter not found: #{inspect(path)} of #{inspect(robot)} has no value; set it, or " <>
          "declare a default"

      :error ->
        "parameter not found: #{inspect(robot)} has no #{inspect(path)}; " <>
          "BB.Parameter.list(#{inspect(robot)}) returns its parameters"
    end
  end

  @doc """
  Sets a parameter.

  Errors:

    * `{:unregistered_parameter, path}` - the robot has neither this parameter nor its group
    * `{:unknown_parameter, name}` - the group exists and has no parameter of this name
    * `BB.Options.ValidationError` - the value has the wrong type or is out of bounds
    * `{:not_kept, reason}` - the value is set, but the store could not save it, for example
      because the disk is full (`:enospc`). The store is tried again until it saves the value;
      until then the alarm `{BB.Parameter, robot, :not_kept}` is set
  """
  @spec set(module(), path(), term()) :: :ok | {:error, reason() | not_kept()}
  def set(robot, path, value) do
    with {:error, [{^path, reason}]} <- set_many(robot, [{path, value}]), do: {:error, reason}
  end

  @doc """
  Sets several parameters, each as `{path, value}`, at the same moment; or none, when one of
  them is wrong. A component that refers to several of them gets all new values at once. If a
  path is given twice, its last value counts.

  The values are saved as one too, if the store supports it, as `BB.Parameter.Store.Log` does:
  after a power failure all are saved or none. `{:error, {:not_kept, reason}}` means that all
  are set but not saved.
  """
  @spec set_many(module(), [{path(), term()}] | %{path() => term()}) ::
          :ok | {:error, [{path(), reason()}] | not_kept()}
  def set_many(robot, changes) do
    Owner.set(robot, Enum.map(changes, &change!/1))
  end

  @doc """
  Lists the parameters with a value at or below `prefix:` (default: all) in the order of their
  paths, each with its value, type, bounds, documentation and default.
  """
  @spec list(module(), prefix: [atom()]) :: [{path(), map()}]
  def list(robot, opts \\ []) do
    prefix = opts |> Keyword.validate!(prefix: []) |> Keyword.fetch!(:prefix)

    for %{path: path} = definition <- Values.definitions(robot),
        List.starts_with?(path, prefix),
        {:ok, value} <- [Values.fetch(robot, path)],
        do: {path, Definition.describe(definition, value)}
  end

  @doc """
  Adds the parameters of a module (`c:param_schema/0`) below `path`, with their persisted values.

  A parameter without a default has no value until it is set, even if the schema says
  `required: true`. A unit in the schema (`BB.Unit.Option`) is a parameter of the type
  `{:unit, unit}`.

  Parameters that are registered again keep their values, if they fit. Errors:

    * `{:not_a_parameter_component, module}` - the module has no `param_schema/0`
    * `{:already_registered, path}` - parameters of another origin exist at or below one of them

  Raises `ArgumentError` for a wrong schema.
  """
  @spec register(module(), path() | [], module()) ::
          :ok
          | {:error, {:already_registered, path()} | {:not_a_parameter_component, module()}}
  def register(robot, path, module) when is_list(path) do
    if implements?(module) do
      definitions = Definition.of_schema!(path, module.param_schema(), {path, module})
      Owner.call(robot, {:register, path, definitions})
    else
      {:error, {:not_a_parameter_component, module}}
    end
  end

  @doc """
  Watches parameters for the calling process. Returns `{:ok, ref, %{path => value}}` with the
  current values, `nil` for a parameter without one.

  Each later `set/3` or `set_many/2` of some of them sends one message
  `{BB.Parameter, ref, %{path => new_value}}`. When the watch ends because the robot's parameters
  are started again, the process receives `{:DOWN, ref, :process, _, _}`.
  """
  @spec watch(module(), [path()]) ::
          {:ok, reference(), %{path() => term()}} | {:error, {:unregistered_parameter, path()}}
  def watch(robot, paths) do
    ref = Process.monitor(Values.name(robot))

    case Owner.call(robot, {:watch, ref, self(), paths}) do
      {:ok, values} ->
        {:ok, ref, values}

      error ->
        Process.demonitor(ref, [:flush])
        error
    end
  end

  @doc """
  Replaces the references in a keyword list or map, such as the limit of a joint, by the current
  values of the parameters (`BB.Parameter.Reference`), by `nil` for a parameter without a value.

  Raises `ArgumentError` for a reference to no parameter.
  """
  @spec resolve(module(), term()) :: term()
  def resolve(robot, fields), do: Reference.resolve(fields, &value_or_nil(robot, &1))

  defp value_or_nil(robot, path) do
    with :error <- Values.fetch(robot, path),
         {:ok, _definition} <- Values.fetch_definition(robot, path) do
      nil
    else
      {:ok, value} -> value
      :error -> get!(robot, path)
    end
  end

  # Parameters of devices, which a bridge reads and writes

  @typedoc "A parameter of a device, as its bridge names it."
  @type remote_id :: term()

  @doc """
  Lists the parameters of the device behind a bridge.

  `bridge` is the bridge's name, and each parameter a map with `:id`, `:value`, `:type`, `:doc`
  and `:path`. Exits as `GenServer.call/3` does when the bridge is down or does not reply in time.
  """
  @spec list_remote(module(), atom()) :: {:ok, [map()]} | {:error, term()}
  def list_remote(robot, bridge), do: call_bridge(robot, bridge, :list_remote)

  @doc "Reads a parameter of the device behind a bridge. See `list_remote/2`."
  @spec get_remote(module(), atom(), remote_id()) :: {:ok, term()} | {:error, term()}
  def get_remote(robot, bridge, id), do: call_bridge(robot, bridge, {:get_remote, id})

  @doc "Sets a parameter of the device behind a bridge. See `list_remote/2`."
  @spec set_remote(module(), atom(), remote_id(), term()) :: :ok | {:error, term()}
  def set_remote(robot, bridge, id, value),
    do: call_bridge(robot, bridge, {:set_remote, id, value})

  @doc """
  Asks a bridge to publish the changes of a parameter of its device. See `list_remote/2`.
  """
  @spec subscribe_remote(module(), atom(), remote_id()) :: :ok | {:error, term()}
  def subscribe_remote(robot, bridge, id),
    do: call_bridge(robot, bridge, {:subscribe_remote, id})

  defp call_bridge(robot, bridge, request),
    do: GenServer.call(BB.Process.Name.via(robot, bridge), request)

  # The guard fails for an improper list.
  defp change!({path, value}) when length(path) > 0, do: {path, value}

  defp change!(other) do
    raise ArgumentError,
          "expected {path, value} with a path such as [:imu, :rate], got: #{inspect(other)}"
  end
end

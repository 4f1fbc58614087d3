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

  A parameter starts with the default of its declaration. The persisted value overrides the
  default, and a value in `start_link(params: [imu: [rate: ~u(50 hertz)]])` overrides both. A
  wrong value in `params:` fails the start. A wrong persisted value is logged and dropped, so
  that no file can prevent the start of a robot. `BB.Parameter.Store` explains which values are
  persisted.

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
  Returns the parameters of a module for `register/3`: `[name: [type: …, default: …]]`, with the
  fields of `param` in a robot's declaration.
  """
  @callback param_schema() :: keyword()

  @doc "Returns a parameter's value: `{:ok, value}`, or `{:error, :not_found}`."
  @spec get(module(), path()) :: {:ok, term()} | {:error, :not_found}
  def get(robot, path) do
    with :error <- Values.fetch(robot, path), do: {:error, :not_found}
  end

  @doc "Returns a parameter's value. Raises `ArgumentError` when the robot has no such parameter."
  @spec get!(module(), path()) :: term()
  def get!(robot, path) do
    case Values.fetch(robot, path) do
      {:ok, value} -> value
      :error -> raise ArgumentError, format_unknown(robot, path)
    end
  end

  defp format_unknown(robot, path) do
    "expected a parameter of #{inspect(robot)}, got: #{inspect(path)}; " <>
      "BB.Parameter.list(#{inspect(robot)}) lists them"
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
    changes = Enum.map(changes, &change!/1)

    # The error shows a wrong value, by code of the value's module: so it is found in this
    # process.
    with :ok <- Owner.check_values(robot, changes), do: Owner.call(robot, {:set, changes})
  end

  @doc """
  Lists the parameters at or below `prefix:` (default: all) in the order of their paths, each with
  its value, type, bounds, documentation and default.
  """
  @spec list(module(), prefix: [atom()]) :: [{path(), map()}]
  def list(robot, opts \\ []) do
    prefix = opts |> Keyword.validate!(prefix: []) |> Keyword.fetch!(:prefix)

    for %{path: path} = definition <- Values.definitions(robot),
        List.starts_with?(path, prefix),
        do: {path, Definition.describe(definition, get!(robot, path))}
  end

  @doc """
  Adds the parameters of a module (`c:param_schema/0`) below `path`, with their persisted values.

  Parameters that are registered again keep their values, if they fit. Returns
  `{:error, {:already_registered, path}}` when parameters of another origin exist at or below
  one of them. Raises `ArgumentError` for a module without a schema, and for a wrong schema.
  """
  @spec register(module(), path(), module()) :: :ok | {:error, {:already_registered, path()}}
  def register(robot, path, module) do
    unless Code.ensure_loaded?(module) and function_exported?(module, :param_schema, 0) do
      raise ArgumentError,
            "expected a module with param_schema/0 (BB.Parameter), got: #{inspect(module)}"
    end

    definitions = Definition.of_schema!(path, module.param_schema(), {path, module})
    Owner.call(robot, {:register, path, definitions})
  end

  @doc """
  Watches parameters for the calling process. Returns `{:ok, ref, %{path => value}}` with the
  current values.

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
  values of the parameters (`BB.Parameter.Reference`).
  """
  @spec resolve(module(), term()) :: term()
  def resolve(robot, fields), do: Reference.resolve(fields, &get!(robot, &1))

  # The guard fails for an improper list.
  defp change!({path, value}) when length(path) > 0, do: {path, value}

  defp change!(other) do
    raise ArgumentError,
          "expected {path, value} with a path such as [:imu, :rate], got: #{inspect(other)}"
  end
end

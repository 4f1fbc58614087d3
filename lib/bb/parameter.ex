defmodule BB.Parameter do
  @moduledoc """
  What of a robot can be tuned while it runs: named values with a type, bounds and a default.

      defmodule MyRobot do
        use BB

        settings do
          parameter_store {BB.Parameter.Store.Log, path: "/data/params"}
        end

        parameters do
          param :debug, type: :boolean, default: false, doc: "Whether to log each sample."

          group :imu do
            param :rate, type: {:unit, :hertz}, default: ~u(100 hertz), min: ~u(1 hertz), max: ~u(1 kilohertz)
          end
        end

        topology do
          link :base_link do
            sensor :imu, {BB.Sensor.Mpu6050, bus: "i2c-1", rate: param([:imu, :rate])}
          end
        end
      end

      BB.Parameter.set(MyRobot, [:imu, :rate], ~u(200 hertz))

  `BB.Parameter.Type` lists the types. A declaration that is wrong is a `BB.Dsl.Error` when the robot compiles.

  ## Reading

  `get/2` reads a table; no process is asked, so it may stand in a loop.

  ## Setting

  `set/3` and `set_many/2` check what they are given; what does not fit changes nothing. They return when the robot's store has kept the
  values for good (`BB.Parameter.Store`). Values with a unit may be given in any that converts, and are kept in the parameter's own. Writes run one after the other, and a value can be read before
  anyone hears of it: each publishes `BB.Parameter.Changed` on `[:param | path]`, with the frame_id `:parameter`, also when the
  value is the old one.

  ## Following

  `param([:imu, :rate])` in a robot's declaration follows the parameter: see `BB.Sensor`. A process of one's own subscribes to
  `[:param, :imu, :rate]`, or to `[:param, :imu]` for the whole group, or uses `watch/2`, which tells the current values and every later
  change, none twice and none missed.

  ## Where values come from

  The default of the declaration, if need be replaced by the persisted value, if need be replaced by that of
  `start_link(params: [imu: [rate: ~u(50 hertz)]])`. A value there that is wrong fails the start; a persisted one is
  logged and dropped, so that no file can keep a robot from starting. `BB.Parameter.Store` says what is kept.

  All functions raise `ArgumentError` when the robot is not started.
  """

  alias BB.Options.ValidationError
  alias BB.Parameter.{Definition, Owner, Reference, Values}

  @typedoc "The names of the groups around a parameter, and its own: `[:imu, :rate]`."
  @type path :: [atom(), ...]

  @type reason ::
          {:unregistered_parameter, path()} | {:unknown_parameter, atom()} | ValidationError.t()

  @type not_kept :: {:not_kept, term()}

  @doc """
  The parameters that a module brings, for `register/3`: `[name: [type: …, default: …]]`, with the fields of `param` in
  the robot's declaration.
  """
  @callback param_schema() :: keyword()

  @doc "A parameter's value."
  @spec get(module(), path()) :: {:ok, term()} | {:error, :not_found}
  def get(robot, path) do
    with :error <- Values.fetch(robot, path), do: {:error, :not_found}
  end

  @doc "A parameter's value itself. Raises `ArgumentError` when there is no such parameter."
  @spec get!(module(), path()) :: term()
  def get!(robot, path) do
    case Values.fetch(robot, path) do
      {:ok, value} -> value
      :error -> raise ArgumentError, "#{inspect(robot)} has no parameter #{inspect(path)}"
    end
  end

  @doc """
  Sets a parameter.

  Errors:

    * `{:unregistered_parameter, path}` - there is no parameter, and no group around it that has any
    * `{:unknown_parameter, name}` - there is such a group, but it has no parameter of that name
    * `BB.Options.ValidationError` - the value is of the wrong type or out of bounds
    * `{:not_kept, reason}` - the value is set, but the store could not keep it, since the disk is full for one
      (`:enospc`). It is tried again until it can; the alarm `{BB.Parameter, robot, :not_kept}` is set for as long as that takes
  """
  @spec set(module(), path(), term()) :: :ok | {:error, reason() | not_kept()}
  def set(robot, path, value) do
    with {:error, [{^path, reason}]} <- set_many(robot, [{path, value}]), do: {:error, reason}
  end

  @doc """
  Sets several parameters, `{path, value}` each, at the same moment; or none, when one of them is wrong. A component that refers to several of
  them takes them on at once. The last value of a path that is given twice counts.

  They are kept as one too: after a power failure all are there or none, if the store can (`BB.Parameter.Store.Log` can).
  `{:error, {:not_kept, reason}}` says that all are set, but not kept.
  """
  @spec set_many(module(), [{path(), term()}] | %{path() => term()}) ::
          :ok | {:error, [{path(), reason()}] | not_kept()}
  def set_many(robot, changes) do
    changes = Enum.map(changes, &change!/1)
    # A wrong value is shown in the error, by code of its module's: it is found out here.
    with :ok <- Owner.check_values(robot, changes), do: Owner.call(robot, {:set, changes})
  end

  @doc """
  The parameters at or below `prefix:` (all by default) in the order of their paths, each with its value, type, bounds, documentation
  and default.
  """
  @spec list(module(), prefix: [atom()]) :: [{path(), map()}]
  def list(robot, opts \\ []) do
    prefix = opts |> Keyword.validate!(prefix: []) |> Keyword.fetch!(:prefix)

    for %{path: path} = definition <- Values.definitions(robot),
        List.starts_with?(path, prefix),
        do: {path, Definition.describe(definition, get!(robot, path))}
  end

  @doc """
  Adds the parameters of a module (`c:param_schema/0`) below `path`, with their persisted values where there are some.

  Registered again they keep their values, as far as those fit. `{:error, {:already_registered, path}}` when there are parameters of another
  origin at or below one of them. Raises `ArgumentError` for a module without a schema, and for a schema that is wrong.
  """
  @spec register(module(), path(), module()) :: :ok | {:error, {:already_registered, path()}}
  def register(robot, path, module) do
    unless Code.ensure_loaded?(module) and function_exported?(module, :param_schema, 0) do
      raise ArgumentError,
            "#{inspect(module)} has no parameters: it needs a function param_schema/0 (BB.Parameter)"
    end

    definitions = Definition.of_schema!(path, module.param_schema(), {path, module})
    Owner.call(robot, {:register, path, definitions})
  end

  @doc """
  Watches parameters for the calling process: `{:ok, ref, %{path => value}}`, the values as they are now.

  Each later `set/3` or `set_many/2` of some of them sends one `{BB.Parameter, ref, %{path => new_value}}`. When the watch ends because the
  robot's parameters are started anew, the process gets `{:DOWN, ref, :process, _, _}`.
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
  A keyword list or map, such as the limit of a joint, with the current values in the place of its references (`param([:a, :b])`).
  """
  @spec resolve(module(), term()) :: term()
  def resolve(robot, fields), do: Reference.resolve(fields, &get!(robot, &1))

  # The length of an improper list is none.
  defp change!({path, value}) when length(path) > 0, do: {path, value}

  defp change!(other) do
    raise ArgumentError,
          "what is set is {path, value} with a path such as [:imu, :rate], got: #{inspect(other)}"
  end
end

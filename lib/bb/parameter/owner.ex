defmodule BB.Parameter.Owner do
  @moduledoc """
  Sets a robot's parameters, one request after the other. `BB.Parameter` calls it.

  It checks a request as a whole. Then it writes all values to the table at the same moment,
  publishes `BB.Parameter.Changed` for each, and sends each watcher one message with the values
  that it watches. `BB.Parameter.Persistence` replies to the caller when the store has saved the
  values; the owner waits for no store.
  """
  @moduledoc no_example: "internal: BB.Parameter is its interface"

  use GenServer
  use BB.Process.Tolerant

  require Logger

  alias BB.{Message, PubSub}
  alias BB.Parameter.{Changed, Definition, Persistence, Startup, Values}

  @enforce_keys [:robot, :given, :persistence]
  defstruct [:robot, :given, :persistence, watchers: %{}]

  @doc false
  def start_link({robot, given}),
    do: GenServer.start_link(__MODULE__, {robot, given}, name: name(robot))

  @doc "Calls a robot's owner. Raises `ArgumentError` when the robot is not started."
  @spec call(module(), term()) :: term()
  def call(robot, request) do
    case Process.whereis(name(robot)) do
      nil -> Values.not_started!(robot)
      # The call exits when the owner ends, and the time of the store is bounded.
      pid -> GenServer.call(pid, request, :infinity)
    end
  end

  @doc """
  Checks values in the calling process: `:ok`, or `{:error, [{path, reason}]}`. The error shows
  the value, which may run code of others.
  """
  @spec check_values(module(), [{BB.Parameter.path(), term()}]) ::
          :ok | {:error, [{BB.Parameter.path(), term()}]}
  def check_values(robot, changes) do
    case check(robot, changes) do
      {:ok, _values} ->
        :ok

      # The owner judges unknown parameters: it knows all, also while the robot starts.
      {:error, errors} ->
        wrong? = Enum.any?(errors, fn {_path, reason} -> is_exception(reason) end)
        if wrong?, do: {:error, errors}, else: :ok
    end
  end

  defp name(robot), do: Module.concat(robot, ParameterOwner)

  @impl GenServer
  def init({robot, given}) do
    owner = %__MODULE__{robot: robot, given: given, persistence: Persistence.whereis(robot)}

    # The table has values of an owner that crashed, which are newer than the declaration.
    missing = Enum.reject(robot.robot().parameters, &known?(owner, &1.path))
    add_parameters(owner, missing)
    {:ok, Enum.reduce(Values.watches(robot), owner, &monitor/2)}
  end

  @impl GenServer
  def handle_call({:set, changes}, from, owner) do
    case check(owner.robot, changes) do
      {:ok, values} -> set(owner, from, values)
      {:error, errors} -> {:reply, {:error, errors}, owner}
    end
  end

  def handle_call({:register, path, definitions}, _from, owner) do
    {:reply, register(owner, path, definitions), owner}
  end

  def handle_call({:watch, ref, pid, paths}, _from, owner) do
    case Enum.reject(paths, &known?(owner, &1)) do
      [] ->
        watch = {ref, pid, paths}
        Values.put_watch(owner.robot, watch)
        {:reply, {:ok, Map.new(paths, &{&1, value!(owner, &1)})}, monitor(watch, owner)}

      [path | _] ->
        {:reply, {:error, {:unregistered_parameter, path}}, owner}
    end
  end

  @impl GenServer
  def handle_info({:DOWN, monitor, :process, _pid, _reason}, owner) do
    {ref, watchers} = Map.pop(owner.watchers, monitor)
    if ref, do: Values.delete_watch(owner.robot, ref)
    {:noreply, %{owner | watchers: watchers}}
  end

  # Setting

  defp check(robot, changes) do
    checked = for {path, value} <- changes, do: {path, cast(robot, path, value)}

    case for {path, {:error, reason}} <- checked, do: {path, reason} do
      [] -> {:ok, Map.new(checked, fn {path, {:ok, value}} -> {path, value} end)}
      errors -> {:error, errors}
    end
  end

  defp cast(robot, path, value) do
    case Values.fetch_definition(robot, path) do
      {:ok, definition} -> Definition.cast(definition, value)
      :error -> {:error, no_parameter(robot, path)}
    end
  end

  defp no_parameter(robot, path) do
    above = Enum.drop(path, -1)
    group? = Enum.any?(Values.definitions(robot), &(Enum.drop(&1.path, -1) == above))

    if group?,
      do: {:unknown_parameter, List.last(path)},
      else: {:unregistered_parameter, path}
  end

  # A robot without a store replies at once.
  defp set(%{persistence: nil} = owner, _from, values) do
    _ = change_values(owner, values, fn -> Values.put_values(owner.robot, values) end)
    Values.put_kept(owner.robot, values)
    {:reply, :ok, owner}
  end

  defp set(owner, from, values) do
    id = make_ref()
    _ = change_values(owner, values, fn -> Values.put_unkept(owner.robot, id, values) end)
    Persistence.save(owner.persistence, from, id, values)
    {:noreply, owner}
  end

  defp change_values(owner, values, put) do
    old = Map.new(values, fn {path, _value} -> {path, value!(owner, path)} end)
    put.()
    for {path, value} <- values, do: publish(owner, path, old[path], value, :local)
    for watch <- Values.watches(owner.robot), do: notify(watch, values)
  end

  defp notify({ref, pid, paths}, values) do
    case Map.take(values, paths) do
      none when none == %{} -> :ok
      watched -> send(pid, {BB.Parameter, ref, watched})
    end
  end

  defp publish(owner, path, old, new, source) do
    {:ok, message} =
      Message.new(Changed, :parameter,
        path: path,
        old_value: old,
        new_value: new,
        source: source
      )

    PubSub.publish(owner.robot, [:param | path], message)
  rescue
    # The pubsub is being restarted, and has no subscriber.
    ArgumentError -> :ok
  end

  # New parameters, declared or registered

  defp add_parameters(owner, definitions) do
    started = for definition <- definitions, do: {definition, start_value(owner, definition)}
    values = for {definition, {value, _source}} <- started, do: {definition.path, value}
    Values.put_values(owner.robot, values)
    Values.put_definitions(owner.robot, definitions)

    for {definition, {value, source}} <- started,
        do: publish(owner, definition.path, nil, value, source)

    :ok
  end

  defp start_value(owner, definition) do
    {value, source, error} = Startup.value(definition, stored(owner, definition), owner.given)

    if error do
      Logger.warning(
        "#{inspect(owner.robot)}: the persisted value of parameter " <>
          "#{inspect(definition.path)} is dropped: #{Exception.message(error)}"
      )
    end

    {value, source}
  end

  defp stored(owner, %{path: path}) do
    case Values.fetch_stored(owner.robot, path) do
      {:ok, value} -> %{path => value}
      :error -> %{}
    end
  end

  defp register(owner, path, definitions) do
    definitions_before = Values.definitions(owner.robot)
    registrant = for definition <- definitions, uniq: true, do: definition.registrant
    {own, others} = Enum.split_with(definitions_before, &(&1.registrant in registrant))

    case Enum.find(definitions, fn new -> Enum.any?(others, &collide?(new.path, &1.path)) end) do
      nil -> replace(owner, own, definitions)
      _clash -> {:error, {:already_registered, path}}
    end
  end

  defp collide?(a, b), do: List.starts_with?(a, b) or List.starts_with?(b, a)

  defp replace(owner, old, new) do
    {kept, fresh} = Enum.split_with(new, &fits?(owner, &1))
    Values.put_definitions(owner.robot, kept)
    add_parameters(owner, fresh)

    for %{path: path} <- old,
        path not in Enum.map(new, & &1.path),
        do: Values.delete(owner.robot, path)

    :ok
  end

  defp fits?(owner, definition) do
    with {:ok, value} <- Values.fetch(owner.robot, definition.path),
         do: match?({:ok, ^value}, Definition.cast(definition, value)),
         else: (:error -> false)
  end

  defp known?(owner, path), do: match?({:ok, _}, Values.fetch_definition(owner.robot, path))

  defp value!(owner, path) do
    {:ok, value} = Values.fetch(owner.robot, path)
    value
  end

  defp monitor({ref, pid, _paths}, owner),
    do: %{owner | watchers: Map.put(owner.watchers, Process.monitor(pid), ref)}
end

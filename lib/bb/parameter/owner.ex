defmodule BB.Parameter.Owner do
  @moduledoc """
  Sets a robot's parameters, one request after the other. `BB.Parameter` calls it.

  The caller casts the values, because that may run code of others. The owner checks that the
  definitions are still the same. Then it writes all values to the table at the same moment,
  publishes `BB.Parameter.Changed` for each, and sends each watcher one message with the values
  that it watches. `BB.Parameter.Persistence` replies to the caller when the store has saved the
  values; the owner waits for no store.
  """
  @moduledoc no_example: "internal: BB.Parameter is its interface"

  use GenServer
  use BB.Process.Tolerant

  require Logger

  alias BB.{Message, PubSub}
  alias BB.Parameter.{Changed, Check, Persistence, Startup, Values}

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
  Sets values, all or none. They are cast in the calling process.
  """
  @spec set(module(), [{BB.Parameter.path(), term()}]) ::
          :ok | {:error, [{BB.Parameter.path(), term()}] | {:not_kept, term()}}
  def set(robot, changes) do
    cast = for {path, value} <- changes, do: cast(robot, path, value)

    # The owner judges unknown parameters: it knows all, also while the robot starts.
    if Enum.any?(cast, &match?({_path, _definition, {:error, _error}}, &1)),
      do: {:error, errors(robot, cast)},
      else: with(:changed <- call(robot, {:set, cast}), do: set(robot, changes))
  end

  defp cast(robot, path, value) do
    case Values.fetch_definition(robot, path) do
      {:ok, definition} -> {path, {:ok, definition}, Check.cast(definition, value)}
      :error -> {path, :error, :unknown}
    end
  end

  defp errors(robot, cast) do
    Enum.flat_map(cast, fn
      {_path, _definition, {:ok, _value}} -> []
      {path, _definition, {:error, error}} -> [{path, error}]
      {path, :error, :unknown} -> [{path, no_parameter(robot, path)}]
    end)
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
  def handle_call({:set, cast}, from, owner) do
    if Enum.all?(cast, &current?(owner, &1)),
      do: set_current(owner, from, cast),
      else: {:reply, :changed, owner}
  end

  # BB.Robot.State.set_parameter/3: no check, and no message.
  def handle_call({:put, path, value}, _from, owner) do
    Values.put_values(owner.robot, [{path, value}])
    for watch <- Values.watches(owner.robot), do: notify(watch, %{path => value})
    {:reply, :ok, owner}
  end

  def handle_call({:register, path, definitions}, _from, owner) do
    {:reply, register(owner, path, definitions), owner}
  end

  def handle_call({:watch, ref, pid, paths}, _from, owner) do
    case Enum.reject(paths, &known?(owner, &1)) do
      [] ->
        watch = {ref, pid, paths}
        Values.put_watch(owner.robot, watch)
        {:reply, {:ok, Map.new(paths, &{&1, value(owner, &1)})}, monitor(watch, owner)}

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

  # The caller may have read the definition while the robot started, or before it changed.
  defp current?(owner, {path, definition, _cast}),
    do: Values.fetch_definition(owner.robot, path) == definition

  defp set_current(owner, from, cast) do
    case errors(owner.robot, cast) do
      [] -> set(owner, from, Map.new(cast, fn {path, _, {:ok, value}} -> {path, value} end))
      errors -> {:reply, {:error, errors}, owner}
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
    old = Map.new(values, fn {path, _value} -> {path, value(owner, path)} end)
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
    started = for definition <- definitions, do: {definition.path, start_value(owner, definition)}
    for {path, :none} <- started, do: Values.delete_value(owner.robot, path)

    Values.put_values(
      owner.robot,
      for({path, {:ok, value, _source}} <- started, do: {path, value})
    )

    Values.put_definitions(owner.robot, definitions)

    for {path, {:ok, value, source}} <- started, do: publish(owner, path, nil, value, source)
    :ok
  end

  defp start_value(owner, definition) do
    {start, error} = Startup.value(definition, stored(owner, definition), owner.given)

    if error do
      Logger.warning(
        "#{inspect(owner.robot)}: the persisted value of parameter " <>
          "#{inspect(definition.path)} is dropped: #{Exception.message(error)}"
      )
    end

    start
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
         do: match?({:ok, ^value}, Check.cast(definition, value)),
         else: (:error -> false)
  end

  defp known?(owner, path), do: match?({:ok, _}, Values.fetch_definition(owner.robot, path))

  defp value(owner, path) do
    case Values.fetch(owner.robot, path) do
      {:ok, value} -> value
      :error -> nil
    end
  end

  defp monitor({ref, pid, _paths}, owner),
    do: %{owner | watchers: Map.put(owner.watchers, Process.monitor(pid), ref)}
end

defmodule BB.PubSub.Bus do
  @moduledoc """
  What a robot's bus consists of, and where to find it.

  In `:persistent_term` under the robot's own module, `{BB.PubSub, routes, bus}`: the routes are what publishers read, and
  reading them takes neither a lock nor a copy. The bus holds the tables:

    * `subscriptions` - `{path, [subscription]}`, in the order of subscribing
    * `traffic` - `{{path, type}, meter}`, one row for each source seen
    * `last` - `{path, sequence, number, message}`, the last messages of retained paths
    * `cells` - `{{subscription_id, path}, cell}`, see `BB.PubSub.Gate`
    * `tallies` - `{subscription_id, delivered, filtered}`, see `BB.PubSub.Traffic`

  and `retained`, the prefixes whose messages are kept.

  The tables belong to the process that starts the bus, which is the robot's root supervisor: they live as long as the robot,
  whatever becomes of the process that writes them (`BB.PubSub.Registrar`).
  """

  alias BB.Path
  alias BB.PubSub.{Routes, Subscription}

  @always_retained [[:param], [:state_machine], [:sensor_status]]
  @tables [:subscriptions, :traffic, :last, :cells, :tallies]

  @enforce_keys [:robot, :registrar, :retained | @tables]
  defstruct [:robot, :registrar, :retained | @tables]

  @type t :: %__MODULE__{
          robot: module(),
          registrar: module(),
          retained: [Path.t()],
          subscriptions: :ets.tid(),
          traffic: :ets.tid(),
          last: :ets.tid(),
          cells: :ets.tid(),
          tallies: :ets.tid()
        }

  @doc "The bus whose tables belong to the calling process, new ones if there are none. To be called when it has no registrar."
  @spec open(module(), module()) :: t()
  def open(robot, registrar) do
    case :persistent_term.get(robot, nil) do
      {BB.PubSub, _routes, bus} ->
        if owner(bus) == self(), do: bus, else: create(robot, registrar)

      nil ->
        create(robot, registrar)

      other ->
        raise ArgumentError,
              "the :persistent_term #{inspect(robot)} belongs to the bus of the robot #{inspect(robot)}, and holds: #{inspect(other)}"
    end
  end

  defp create(robot, registrar) do
    bus = %__MODULE__{
      robot: robot,
      registrar: registrar,
      retained: @always_retained,
      subscriptions: :ets.new(registrar, [:set, :public, read_concurrency: true]),
      traffic: :ets.new(registrar, [:set, :public, read_concurrency: true]),
      last: :ets.new(registrar, [:set, :public, write_concurrency: true]),
      cells: :ets.new(registrar, [:ordered_set, :public]),
      tallies: :ets.new(registrar, [:set, :public])
    }

    publish(bus, Routes.new())
    bus
  end

  @doc "Makes routes and bus known to publishers: whoever publishes when this has returned uses them."
  @spec publish(t(), Routes.t()) :: :ok
  def publish(bus, routes), do: :persistent_term.put(bus.robot, {BB.PubSub, routes, bus})

  @doc "The bus of a robot as publishers know it."
  @spec fetch(module()) :: {:ok, t()} | :error
  def fetch(robot) when is_atom(robot) do
    case :persistent_term.get(robot, nil) do
      {BB.PubSub, _routes, bus} -> if owner(bus) != :undefined, do: {:ok, bus}, else: :error
      _ -> :error
    end
  end

  def fetch(robot), do: raise(ArgumentError, "a robot is a module, got: #{inspect(robot)}")

  @doc "The same, or an `ArgumentError` that says what to do."
  @spec fetch!(module()) :: t()
  def fetch!(robot) do
    case fetch(robot) do
      {:ok, bus} ->
        bus

      :error ->
        raise ArgumentError,
              "the robot #{inspect(robot)} is not started: start it under a supervisor or with #{inspect(robot)}.start_link() first"
    end
  end

  @doc "Forgets the bus, unless another has taken its place."
  @spec close(t()) :: :ok
  def close(bus) do
    with {BB.PubSub, _routes, %{subscriptions: tid}} when tid == bus.subscriptions <-
           :persistent_term.get(bus.robot, nil),
         do: :persistent_term.erase(bus.robot)

    for table <- @tables, tid = Map.fetch!(bus, table), :ets.info(tid, :id) != :undefined do
      :ets.delete(tid)
    end

    :ok
  end

  @doc "Whether the process that started the bus is there."
  @spec owned?(t()) :: boolean()
  def owned?(bus) do
    owner = owner(bus)
    is_pid(owner) and Process.alive?(owner)
  end

  defp owner(bus), do: :ets.info(bus.subscriptions, :owner)

  @doc "The subscriptions at exactly that path, oldest first."
  @spec subscriptions(t(), Path.t()) :: [Subscription.t()]
  def subscriptions(bus, path) do
    case :ets.lookup(bus.subscriptions, path) do
      [{_, subscriptions}] -> subscriptions
      [] -> []
    end
  end

  @doc "All subscriptions."
  @spec subscriptions(t()) :: [Subscription.t()]
  def subscriptions(bus),
    do: Enum.flat_map(:ets.tab2list(bus.subscriptions), fn {_path, list} -> list end)

  @doc "The subscriptions at the path and above it, nearest first."
  @spec above(t(), Path.t()) :: [Subscription.t()]
  def above(bus, path),
    do: subscriptions(bus, path) ++ Enum.flat_map(Path.ancestors(path), &subscriptions(bus, &1))

  @doc "Whether the last messages at the path are kept."
  @spec retained?(t(), Path.t()) :: boolean()
  def retained?(bus, path), do: Enum.any?(bus.retained, &Path.prefix?(&1, path))
end

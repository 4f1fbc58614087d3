defmodule BB.PubSub.Bus do
  @moduledoc """
  The parts of a robot's pubsub, and where to find them.

  Every function of `BB.PubSub` begins with it:

      bus = Bus.fetch!(MyRobot)

  The term `{BB.PubSub.Bus, routes, bus}` is in `:persistent_term` under the robot's module:
  publishers read the routes there without a lock or a copy. The pubsub holds the tables:

    * `subscriptions` and `places` - see `BB.PubSub.Subscriptions`
    * `streams` - `{{path, type}, meter}`, one row for each permanent stream
    * `transient` - see `BB.PubSub.TransientPaths`
    * `last` - `{path, sequence, number, message}`, the last messages of retained paths
    * `cells` - `{{subscription_id, path}, cell}`, see `BB.PubSub.Cells`

  and `retained`, the prefixes below which messages are kept.

  The tables belong to the process that starts the pubsub, the robot's root supervisor. So they
  live as long as the robot, even if the process that writes them (`BB.PubSub.Registrar`) dies.
  """

  alias BB.Path
  alias BB.PubSub.Routes

  @always_retained [[:param], [:state_machine], [:sensor_status]]
  @most_retained 1_000
  @tables [:subscriptions, :places, :streams, :transient, :last, :cells]

  @enforce_keys [:robot, :registrar, :retained | @tables]
  defstruct [:robot, :registrar, :retained | @tables]

  @type t :: %__MODULE__{
          robot: module(),
          registrar: module(),
          retained: %{Path.t() => true},
          subscriptions: :ets.tid(),
          places: :ets.tid(),
          streams: :ets.tid(),
          transient: :ets.tid(),
          last: :ets.tid(),
          cells: :ets.tid()
        }

  @doc """
  Returns the pubsub whose tables belong to the calling process, a new one if there is none.

  The pubsub must have no registrar at the time.
  """
  @spec open(module(), module()) :: t()
  def open(robot, registrar) do
    case :persistent_term.get(robot, nil) do
      {__MODULE__, _routes, bus} ->
        if owner(bus) == self(), do: bus, else: create(robot, registrar)

      nil ->
        create(robot, registrar)

      other ->
        raise ArgumentError,
              "expected the :persistent_term key #{inspect(robot)} to be free for the pubsub " <>
                "of that robot, got: #{inspect(other)}"
    end
  end

  defp create(robot, registrar) do
    bus = %__MODULE__{
      robot: robot,
      registrar: registrar,
      retained: Map.new(@always_retained, &{&1, true}),
      subscriptions: :ets.new(registrar, [:set, :public, read_concurrency: true]),
      places: :ets.new(registrar, [:ordered_set, :public, read_concurrency: true]),
      streams: :ets.new(registrar, [:ordered_set, :public, read_concurrency: true]),
      transient: :ets.new(registrar, [:ordered_set, :public, write_concurrency: true]),
      last: :ets.new(registrar, [:set, :public, write_concurrency: true]),
      cells: :ets.new(registrar, [:ordered_set, :public, write_concurrency: true])
    }

    publish(bus, Routes.new())
    bus
  end

  @doc "Makes routes and pubsub known: every publication that begins after the return uses them."
  @spec publish(t(), Routes.t()) :: :ok
  def publish(bus, routes), do: :persistent_term.put(bus.robot, {__MODULE__, routes, bus})

  @doc "Returns the routes that publishers use now."
  @spec routes(t()) :: Routes.t()
  def routes(bus) do
    {__MODULE__, routes, _bus} = :persistent_term.get(bus.robot)
    routes
  end

  @doc "Returns a robot's pubsub as publishers know it, or `:error` if the robot is not started."
  @spec fetch(module()) :: {:ok, t()} | :error
  def fetch(robot) when is_atom(robot) do
    case :persistent_term.get(robot, nil) do
      {__MODULE__, _routes, bus} -> if owner(bus) != :undefined, do: {:ok, bus}, else: :error
      _ -> :error
    end
  end

  def fetch(robot),
    do: raise(ArgumentError, "expected a robot's module, got: #{inspect(robot)}")

  @doc "Returns a robot's pubsub. Raises `ArgumentError` if the robot is not started."
  @spec fetch!(module()) :: t()
  def fetch!(robot) do
    case fetch(robot) do
      {:ok, bus} ->
        bus

      :error ->
        raise ArgumentError,
              "robot #{inspect(robot)} is not started; start it under a supervisor or with " <>
                "#{inspect(robot)}.start_link()"
    end
  end

  @doc "Deletes the pubsub, and its entry for publishers unless another pubsub has replaced that."
  @spec close(t()) :: :ok
  def close(bus) do
    with {__MODULE__, _routes, %{subscriptions: tid}} when tid == bus.subscriptions <-
           :persistent_term.get(bus.robot, nil),
         do: :persistent_term.erase(bus.robot)

    for table <- @tables, tid = Map.fetch!(bus, table), :ets.info(tid, :id) != :undefined do
      :ets.delete(tid)
    end

    :ok
  end

  @doc "Returns whether the process that started the pubsub is alive."
  @spec owned?(t()) :: boolean()
  def owned?(bus) do
    owner = owner(bus)
    is_pid(owner) and Process.alive?(owner)
  end

  defp owner(bus), do: :ets.info(bus.subscriptions, :owner)

  @doc "Returns whether the last messages at the path are kept."
  @spec retained?(t(), Path.t()) :: boolean()
  def retained?(%{retained: retained}, path) do
    is_map_key(retained, path) or Enum.any?(Path.ancestors(path), &is_map_key(retained, &1))
  end

  @doc """
  Returns the pubsub with a further retained prefix, or `{:error, most}` if it has as many as it
  may have.
  """
  @spec retain(t(), Path.t()) :: {:ok, t()} | {:error, pos_integer()}
  def retain(%{retained: retained} = bus, prefix) do
    cond do
      retained?(bus, prefix) ->
        {:ok, bus}

      map_size(retained) < @most_retained ->
        {:ok, %{bus | retained: Map.put(retained, prefix, true)}}

      true ->
        {:error, @most_retained}
    end
  end
end

defmodule BB.PubSub.Bus do
  @moduledoc """
  What a robot's bus consists of, and where to find it.

  In `:persistent_term` under the robot's own module, `{BB.PubSub, routes, bus}`: the routes are
  what publishers read, and reading them takes neither a lock nor a copy. The bus holds the
  tables:

    * `subscriptions` and `places` - see `BB.PubSub.Pages`
    * `traffic` - `{{path, type}, meter}`, one row for each source that lasts
    * `passing` - what is remembered of all others, see `BB.PubSub.Passing`
    * `last` - `{path, sequence, number, message}`, the last messages of retained paths
    * `cells` - `{{subscription_id, path}, cell}`, see `BB.PubSub.Gate`

  and `retained`, the prefixes whose messages are kept.

  The tables belong to the process that starts the bus, which is the robot's root supervisor: they
  live as long as the robot, whatever becomes of the process that writes them
  (`BB.PubSub.Registrar`).
  """

  alias BB.Path
  alias BB.PubSub.Routes

  @always_retained [[:param], [:state_machine], [:sensor_status]]
  @most_retained 1_000
  @tables [:subscriptions, :places, :traffic, :passing, :last, :cells]

  @enforce_keys [:robot, :registrar, :retained | @tables]
  defstruct [:robot, :registrar, :retained | @tables]

  @type t :: %__MODULE__{
          robot: module(),
          registrar: module(),
          retained: %{Path.t() => true},
          subscriptions: :ets.tid(),
          places: :ets.tid(),
          traffic: :ets.tid(),
          passing: :ets.tid(),
          last: :ets.tid(),
          cells: :ets.tid()
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
      retained: Map.new(@always_retained, &{&1, true}),
      subscriptions: :ets.new(registrar, [:set, :public, read_concurrency: true]),
      places: :ets.new(registrar, [:ordered_set, :public, read_concurrency: true]),
      traffic: :ets.new(registrar, [:ordered_set, :public, read_concurrency: true]),
      passing: :ets.new(registrar, [:ordered_set, :public, write_concurrency: true]),
      last: :ets.new(registrar, [:set, :public, write_concurrency: true]),
      cells: :ets.new(registrar, [:ordered_set, :public, write_concurrency: true])
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

  @doc "Whether the last messages at the path are kept."
  @spec retained?(t(), Path.t()) :: boolean()
  def retained?(%{retained: retained}, path) do
    is_map_key(retained, path) or Enum.any?(Path.ancestors(path), &is_map_key(retained, &1))
  end

  @doc """
  The bus that keeps the messages at and below a prefix too; `{:error, most}` when it has as many
  prefixes as it can have.
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

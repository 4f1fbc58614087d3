defmodule BB.Parameter.Store do
  @moduledoc """
  The behaviour of stores, which save parameters while the robot is off. Use
  `BB.Parameter.Store.Log`; write your own store when values belong somewhere else, such as on a
  server. A robot names its store with `settings parameter_store: {Module, opts}`.

      defmodule MyRobot.Store do
        @behaviour BB.Parameter.Store

        @impl BB.Parameter.Store
        def init(robot, opts), do: {:ok, open(robot, opts)}

        @impl BB.Parameter.Store
        def load(store), do: {:ok, all(store)}

        @impl BB.Parameter.Store
        def save(store, path, value), do: put(store, path, value)

        @impl BB.Parameter.Store
        def close(store), do: shut(store)
      end

  All callbacks of a robot's store run in one process, one after the other. `BB.Parameter.set/3`
  and `set_many/2` return when their values are saved. Values that wait at the same time are saved
  together.

  The values of `set/3` and `set_many/2` are saved, never defaults or the values of
  `start_link(params: …)`. The values of `load/1` are checked as any other; a value that does not
  fit its parameter is logged and dropped.

  ## When a store fails

  A callback may return an error, raise, throw, exit, return a wrong value, or not return: its
  process is killed after five seconds. The robot keeps running with its values. A value that
  cannot be saved is set all the same, `set/3` returns `{:error, {:not_kept, reason}}`, and the
  alarm `{BB.Parameter, robot, :not_kept}` is set. The store is tried again with the next value
  and every few seconds. When it works again, it receives all missing values, and the alarm is
  cleared.

  A store that could not be opened or loaded is opened and loaded again, and is not written
  before. The robot uses its values at the next start.
  """

  @type state :: term()

  @typedoc """
  The damage that a store found: the file, its new name (`nil` when it could not be renamed), and
  the number of lost values.
  """
  @type damage :: %{
          file: Path.t(),
          kept_as: Path.t() | nil,
          lost: non_neg_integer() | :unknown
        }

  @doc "Opens the store."
  @callback init(robot :: module(), opts :: keyword()) :: {:ok, state()} | {:error, term()}

  @doc "Returns all values in the store, each as `{path, value}`."
  @callback load(state()) :: {:ok, [{BB.Parameter.path(), term()}]} | {:error, term()}

  @doc "Saves a value. After `:ok` the value must survive a power failure."
  @callback save(state(), BB.Parameter.path(), value :: term()) :: :ok | {:error, term()}

  @doc """
  Saves several values, all or none. A store without this callback receives each value by
  `c:save/3`, and the values of one `BB.Parameter.set_many/2` may then be saved in part.
  """
  @callback save_many(state(), [{BB.Parameter.path(), value :: term()}]) ::
              :ok | {:error, term()}

  @doc """
  Returns the damage that the store found when it was opened, or `nil`, for the alarm
  `{BB.Parameter, robot, :damaged}`.
  """
  @callback damage(state()) :: nil | damage()

  @doc "Closes the store, when the robot is stopped."
  @callback close(state()) :: :ok | {:error, term()}

  @optional_callbacks save_many: 2, damage: 1

  @doc """
  Formats a damage, as a sentence about the file.

      iex> BB.Parameter.Store.format_damage(%{file: "/data/params", kept_as: nil, lost: 2})
      "cannot be read as a whole; 2 values are lost; the file keeps its name"
  """
  @spec format_damage(damage()) :: String.t()
  def format_damage(damage),
    do: "cannot be read as a whole; #{format_lost(damage)}; #{format_kept_as(damage)}"

  defp format_lost(%{lost: :unknown}), do: "the number of lost values is unknown"
  defp format_lost(%{lost: 0}), do: "no value is lost"
  defp format_lost(%{lost: 1}), do: "1 value is lost"
  defp format_lost(%{lost: count}), do: "#{count} values are lost"

  defp format_kept_as(%{kept_as: nil}), do: "the file keeps its name"

  defp format_kept_as(%{kept_as: kept_as}),
    do: "the file is renamed to #{kept_as}, and a new one begins"
end

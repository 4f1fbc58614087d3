defmodule BB.Parameter.Store do
  @moduledoc """
  Where parameters are kept while the robot is off: a behaviour, and `settings parameter_store
  {Module, opts}` in the robot. `BB.Parameter.Store.Log` is the one to take; write your own when
  values belong somewhere else, such as on a server.

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

  All callbacks of a robot's store run in one process of their own, one after the other.
  `BB.Parameter.set/3` and `set_many/2` return when their values are saved. Values that wait at
  the same time are saved together.

  What is saved is what `set/3` and `set_many/2` set, never defaults or the values of
  `start_link(params: …)`. What `load/1` returns is checked as any other value; one that does
  not fit its parameter (any more) is logged and dropped.

  ## When a store fails

  A callback may return an error, raise, throw, exit, return something else, or not return: after
  five seconds its process is killed. The robot runs, with the values that it has. What cannot be
  saved is set all the same, `set/3` returns `{:error, {:not_kept, reason}}`, and the alarm
  `{BB.Parameter, robot, :not_kept}` is set. The store is tried again with the next value and
  every few seconds; when it works again it gets all that it missed, and the alarm is cleared.

  A store that could not be opened or loaded is opened and loaded anew. It is not written before.
  The values that it turns out to have are taken on at the robot's next start.
  """

  @type state :: term()

  @typedoc """
  What a store found damaged: the file, the name under which it is kept (`nil` when it could not
  be renamed), and how many values are lost.
  """
  @type damage :: %{
          file: Path.t(),
          kept_as: Path.t() | nil,
          lost: non_neg_integer() | :unknown
        }

  @doc "Opens the store."
  @callback init(robot :: module(), opts :: keyword()) :: {:ok, state()} | {:error, term()}

  @doc "All that is stored, `{path, value}` each."
  @callback load(state()) :: {:ok, [{BB.Parameter.path(), term()}]} | {:error, term()}

  @doc "Stores a value, for good: it is there after a power failure when this has returned `:ok`."
  @callback save(state(), BB.Parameter.path(), value :: term()) :: :ok | {:error, term()}

  @doc """
  Stores several values, all or none. A store without this callback gets each value by `c:save/3`,
  and a `BB.Parameter.set_many/2` may then be stored in part.
  """
  @callback save_many(state(), [{BB.Parameter.path(), value :: term()}]) ::
              :ok | {:error, term()}

  @doc """
  What was found damaged when the store was opened, for the alarm `{BB.Parameter, robot,
  :damaged}`.
  """
  @callback damage(state()) :: nil | damage()

  @doc "Closes the store, when the robot is stopped."
  @callback close(state()) :: :ok | {:error, term()}

  @optional_callbacks save_many: 2, damage: 1

  @doc """
  A damage in words.

      iex> BB.Parameter.Store.damage_words(%{file: "/data/params", kept_as: nil, lost: 2})
      "cannot be read as a whole; 2 values are lost; it stays as it is"
  """
  @spec damage_words(damage()) :: String.t()
  def damage_words(damage), do: "cannot be read as a whole; #{lost(damage)}; #{kept(damage)}"

  defp lost(%{lost: :unknown}), do: "how many values are lost cannot be known"
  defp lost(%{lost: 0}), do: "no value is lost"
  defp lost(%{lost: 1}), do: "1 value is lost"
  defp lost(%{lost: count}), do: "#{count} values are lost"

  defp kept(%{kept_as: nil}), do: "it stays as it is"
  defp kept(%{kept_as: kept_as}), do: "it is now #{kept_as}, and a new one is begun"
end

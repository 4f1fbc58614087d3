defmodule BB.Parameter.Store do
  @moduledoc """
  Where parameters are kept while the robot is off: a behaviour, and `settings parameter_store {Module, opts}` in the robot.

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

  All callbacks run in the process that serialises the robot's writes; `BB.Parameter.set/3` returns when `save/3` has. A store
  that fails, in whatever way, costs a warning in the log: the robot runs, with the values that it has.

  What is saved is what `set/3` and `set_many/2` set, never defaults or the values of `start_link(params: …)`. What `load/1`
  returns is checked as any other value; a value that does not fit its parameter (any more) is logged and dropped.
  """

  @type state :: term()

  @doc "Opens the store."
  @callback init(robot :: module(), opts :: keyword()) :: {:ok, state()} | {:error, term()}

  @doc "All that is stored, `{path, value}` each."
  @callback load(state()) :: {:ok, [{BB.Parameter.path(), term()}]} | {:error, term()}

  @doc "Stores a value."
  @callback save(state(), BB.Parameter.path(), value :: term()) :: :ok | {:error, term()}

  @doc "Closes the store, when the robot is stopped."
  @callback close(state()) :: :ok | {:error, term()}
end

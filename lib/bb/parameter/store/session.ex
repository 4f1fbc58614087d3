defmodule BB.Parameter.Store.Session do
  @moduledoc """
  A store that is open and loaded, in a worker process of its own. `BB.Parameter.Persistence` uses
  it. The session checks the results of the callbacks.
  """
  @moduledoc no_example: "internal: BB.Parameter.Store is the behaviour behind it"

  alias BB.Parameter.Store
  alias BB.Parameter.Store.Worker

  @timeout_ms 5_000

  @enforce_keys [:module, :worker, :state]
  defstruct [:module, :worker, :state]

  @type t :: %__MODULE__{module: module(), worker: pid(), state: Store.state()}
  @type values :: %{BB.Parameter.path() => term()}

  @doc "Opens and loads a store. A failure has a verb, which says what failed, and a reason."
  @spec open(module(), module(), keyword()) ::
          {:ok, t(), values()} | {:error | :gone, verb :: String.t(), reason :: term()}
  def open(robot, module, opts) do
    worker = Worker.start_link()

    case run(worker, &check_state/1, fn -> module.init(robot, opts) end) do
      {:ok, state} -> load(%__MODULE__{module: module, worker: worker, state: state})
      {kind, reason} -> stop_with(worker, kind, "open", reason)
    end
  end

  defp load(%{module: module, state: state} = session) do
    case run(session.worker, &check_values/1, fn -> module.load(state) end) do
      {:ok, values} ->
        {:ok, session, values}

      {kind, reason} ->
        if kind == :error, do: run(session.worker, &check_ok/1, fn -> module.close(state) end)
        stop_with(session.worker, kind, "load", reason)
    end
  end

  defp stop_with(worker, kind, verb, reason) do
    Worker.stop(worker)
    {kind, verb, reason}
  end

  @doc "Returns whether the store saves several values as one."
  @spec atomic?(t()) :: boolean()
  def atomic?(%{module: module}), do: function_exported?(module, :save_many, 2)

  @doc "Saves values as one."
  @spec save_many(t(), [{BB.Parameter.path(), term()}]) ::
          {:ok, :ok} | {:error | :gone, reason :: term()}
  def save_many(%{module: module, state: state} = session, values),
    do: run(session.worker, &check_ok/1, fn -> module.save_many(state, values) end)

  @doc "Saves a value."
  @spec save(t(), BB.Parameter.path(), term()) :: {:ok, :ok} | {:error | :gone, reason :: term()}
  def save(%{module: module, state: state} = session, path, value),
    do: run(session.worker, &check_ok/1, fn -> module.save(state, path, value) end)

  @doc "Returns the damage that the store found when it was opened, or `nil`."
  @spec damage(t()) :: {:ok, Store.damage() | nil} | {:error | :gone, reason :: term()}
  def damage(%{module: module, state: state} = session) do
    if function_exported?(module, :damage, 1),
      do: run(session.worker, &check_damage/1, fn -> module.damage(state) end),
      else: {:ok, nil}
  end

  @doc "Closes the store and stops its worker."
  @spec close(t()) :: {:ok, :ok} | {:error | :gone, reason :: term()}
  def close(%{module: module, state: state} = session) do
    closed = run(session.worker, &check_ok/1, fn -> module.close(state) end)
    Worker.stop(session.worker)
    closed
  end

  # The worker checks the result, too.
  defp run(worker, check, fun) do
    with {:ok, result} <- Worker.call(worker, fn -> check.(fun.()) end, @timeout_ms), do: result
  end

  defp check_state({:ok, state}), do: {:ok, state}
  defp check_state(other), do: failure(other)

  defp check_values({:ok, pairs} = loaded) do
    if is_list(pairs) and Enum.all?(pairs, &match?({_path, _value}, &1)),
      do: {:ok, Map.new(pairs)},
      else: failure(loaded)
  end

  defp check_values(other), do: failure(other)

  defp check_ok(:ok), do: {:ok, :ok}
  defp check_ok(other), do: failure(other)

  defp check_damage(nil), do: {:ok, nil}
  defp check_damage(%{file: _, kept_as: _, lost: _} = damage), do: {:ok, damage}
  defp check_damage(other), do: failure(other)

  defp failure({:error, reason}), do: {:error, reason}
  defp failure(other), do: {:error, {:bad_return_value, other}}
end

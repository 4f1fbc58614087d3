defmodule BB.Parameter.Store.Session do
  @moduledoc """
  A store that has been opened and loaded, in a process of its own. The results of its callbacks
  are checked here.
  """

  alias BB.Parameter.Store
  alias BB.Parameter.Store.Worker

  @timeout_ms 5_000

  @enforce_keys [:module, :worker, :state]
  defstruct [:module, :worker, :state]

  @type t :: %__MODULE__{module: module(), worker: pid(), state: Store.state()}
  @type values :: %{BB.Parameter.path() => term()}

  @doc "Opens and loads a store. The reason of a failure comes with what failed, as a verb."
  @spec open(module(), module(), keyword()) ::
          {:ok, t(), values()} | {:error | :gone, verb :: String.t(), reason :: term()}
  def open(robot, module, opts) do
    worker = Worker.start_link()

    case ask(worker, &value/1, fn -> module.init(robot, opts) end) do
      {:ok, state} -> load(%__MODULE__{module: module, worker: worker, state: state})
      {kind, reason} -> give_up(worker, kind, "open", reason)
    end
  end

  defp load(%{module: module, state: state} = session) do
    case ask(session.worker, &values/1, fn -> module.load(state) end) do
      {:ok, values} ->
        {:ok, session, values}

      {kind, reason} ->
        if kind == :error, do: ask(session.worker, &done/1, fn -> module.close(state) end)
        give_up(session.worker, kind, "load", reason)
    end
  end

  defp give_up(worker, kind, verb, reason) do
    Worker.stop(worker)
    {kind, verb, reason}
  end

  @doc "Whether the store takes several values as one."
  @spec atomic?(t()) :: boolean()
  def atomic?(%{module: module}), do: function_exported?(module, :save_many, 2)

  @doc "Stores values as one."
  @spec save_many(t(), [{BB.Parameter.path(), term()}]) ::
          {:ok, :ok} | {:error | :gone, reason :: term()}
  def save_many(%{module: module, state: state} = session, values),
    do: ask(session.worker, &done/1, fn -> module.save_many(state, values) end)

  @doc "Stores a value."
  @spec save(t(), BB.Parameter.path(), term()) :: {:ok, :ok} | {:error | :gone, reason :: term()}
  def save(%{module: module, state: state} = session, path, value),
    do: ask(session.worker, &done/1, fn -> module.save(state, path, value) end)

  @doc "What the store found damaged when it was opened; nothing, when it cannot say."
  @spec damage(t()) :: {:ok, Store.damage() | nil} | {:error | :gone, reason :: term()}
  def damage(%{module: module, state: state} = session) do
    if function_exported?(module, :damage, 1),
      do: ask(session.worker, &damage_of/1, fn -> module.damage(state) end),
      else: {:ok, nil}
  end

  @doc "Closes the store and ends its process."
  @spec close(t()) :: {:ok, :ok} | {:error | :gone, reason :: term()}
  def close(%{module: module, state: state} = session) do
    closed = ask(session.worker, &done/1, fn -> module.close(state) end)
    Worker.stop(session.worker)
    closed
  end

  # What a callback returned is looked at in the store's process too.
  defp ask(worker, check, fun) do
    with {:ok, result} <- Worker.call(worker, fn -> check.(fun.()) end, @timeout_ms), do: result
  end

  defp value({:ok, state}), do: {:ok, state}
  defp value(other), do: failed(other)

  defp values({:ok, pairs} = loaded) do
    if is_list(pairs) and Enum.all?(pairs, &match?({_path, _value}, &1)),
      do: {:ok, Map.new(pairs)},
      else: failed(loaded)
  end

  defp values(other), do: failed(other)

  defp done(:ok), do: {:ok, :ok}
  defp done(other), do: failed(other)

  defp damage_of(nil), do: {:ok, nil}
  defp damage_of(%{file: _, kept_as: _, lost: _} = damage), do: {:ok, damage}
  defp damage_of(other), do: failed(other)

  defp failed({:error, reason}), do: {:error, reason}
  defp failed(other), do: {:error, {:bad_return_value, other}}
end

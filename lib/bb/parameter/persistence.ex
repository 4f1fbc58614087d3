defmodule BB.Parameter.Persistence do
  @moduledoc """
  A robot's parameter store, of which nothing that it does wrong gets further than the log. Without a store it keeps nothing.
  """

  require Logger

  @enforce_keys [:robot]
  defstruct [:robot, :module, :state]

  @type t :: %__MODULE__{robot: module(), module: module() | nil, state: term()}

  @doc "Opens the store that the robot declares and loads it: `{persistence, %{path => value}}`."
  @spec open(module()) :: {t(), %{BB.Parameter.path() => term()}}
  def open(robot) do
    nothing = {%__MODULE__{robot: robot}, %{}}

    case robot.robot().settings[:parameter_store] do
      nil -> nothing
      {module, opts} -> open(robot, module, opts) || nothing
      module -> open(robot, module, []) || nothing
    end
  end

  defp open(robot, module, opts) do
    with {:ok, state} <- attempt(robot, module, "open", fn -> module.init(robot, opts) end) do
      store = %__MODULE__{robot: robot, module: module, state: state}
      {store, load(store)}
    end
  end

  defp load(%{module: module, state: state} = store) do
    loaded =
      attempt(store.robot, module, "load", fn ->
        with {:ok, pairs} <- module.load(state), do: {:ok, Map.new(pairs)}
      end)

    case loaded do
      {:ok, values} -> values
      nil -> %{}
    end
  end

  @doc "Stores values."
  @spec save(t(), Enumerable.t()) :: :ok
  def save(%__MODULE__{module: nil}, _values), do: :ok

  def save(%__MODULE__{module: module, state: state} = store, values) do
    Enum.each(values, fn {path, value} ->
      attempt(store.robot, module, "save #{inspect(path)} in", fn ->
        module.save(state, path, value)
      end)
    end)
  end

  @doc "Closes the store."
  @spec close(t()) :: :ok
  def close(%__MODULE__{module: nil}), do: :ok

  def close(%__MODULE__{module: module, state: state} = store) do
    _ = attempt(store.robot, module, "close", fn -> module.close(state) end)
    :ok
  end

  defp attempt(robot, module, what, fun) do
    case fun.() do
      :ok -> :ok
      {:ok, value} -> {:ok, value}
      {:error, reason} -> warn(robot, module, what, reason)
      other -> warn(robot, module, what, {:bad_return_value, other})
    end
  catch
    _kind, reason -> warn(robot, module, what, reason)
  end

  defp warn(robot, module, what, reason) do
    reason = if is_exception(reason), do: Exception.message(reason), else: inspect(reason)

    Logger.warning(
      "#{inspect(robot)}: cannot #{what} the parameter store #{inspect(module)}: #{reason}"
    )

    nil
  end
end

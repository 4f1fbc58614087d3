defmodule BB.Command.Outcome do
  @moduledoc """
  Takes the result of an execution from its handler. `BB.Command.Server` calls it in the process
  of the execution when that is about to end.

  | end | result |
  |---|---|
  | the handler stopped, or was stopped | `result/1` of the handler |
  | the same, for a reason that is neither `:normal` nor a shutdown, and `result/1` gives none | `{:error, {:command_failed, reason}}` |
  | `result/1` returned something else | `{:error, %BB.Error.Invalid.CommandResult{}}` |
  | a callback or `result/1` raised, threw or exited | `{:error, %BB.Error.State.CommandCrashed{}}` |
  """
  @moduledoc no_example: "internal: BB.Command.await/2 returns its result"

  alias BB.Callback
  alias BB.Error.Invalid.CommandResult
  alias BB.Error.State.CommandCrashed

  @doc "Returns the result of a handler that has stopped with `reason` and this state."
  @spec of(module(), atom(), state :: term(), reason :: term()) :: BB.Command.Results.result()
  def of(module, name, state, reason) do
    case module.result(state) do
      {:ok, value} -> {:ok, value}
      {:ok, value, options} when is_list(options) -> {:ok, value, options}
      {:error, reason} -> {:error, reason}
      other -> {:error, invalid(module, other, reason)}
    end
  catch
    kind, raised -> {:error, crash(name, normalize(kind, raised, __STACKTRACE__))}
  end

  defp invalid(module, value, reason) do
    if orderly?(reason),
      do: %CommandResult{command: module, value: Callback.showable(value)},
      else: {:command_failed, reason}
  end

  @doc "Returns whether a process that ends with `reason` ends as it should."
  @spec orderly?(term()) :: boolean()
  def orderly?(reason), do: reason in [:normal, :shutdown] or match?({:shutdown, _}, reason)

  @doc "Returns the error of a command that has crashed."
  @spec crash(atom(), term()) :: Exception.t()
  def crash(name, exception),
    do: %CommandCrashed{command: name, exception: Callback.showable(exception)}

  @doc "Returns the exception of an error, and the reason of a throw or an exit."
  @spec normalize(:error | :throw | :exit, term(), Exception.stacktrace()) :: term()
  def normalize(:error, reason, stacktrace), do: Exception.normalize(:error, reason, stacktrace)
  def normalize(:throw, value, _stacktrace), do: {:nocatch, value}
  def normalize(:exit, reason, _stacktrace), do: reason
end

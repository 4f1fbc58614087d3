defmodule BB.Safety.Round do
  @moduledoc """
  One disarming of a robot: all handlers run at once, each in a process of its own, until a common
  deadline. `BB.Safety.Warden` begins and closes rounds.

  Each handler has a run, a row in `BB.Safety.Records`. A process claims the run before it calls
  the handler, which only one process can do, and writes the outcome to it. When the warden
  dies, its successor finds the outcomes, waits for the handlers that still run, and calls no
  handler twice.
  """
  @moduledoc no_example: "internal: BB.Safety.disarm/2 is its interface"

  alias BB.Callback
  alias BB.Safety.Records

  @enforce_keys [:id, :timeout_ms, :deadline_ms, :started]
  defstruct [:id, :timeout_ms, :deadline_ms, :started, :cause]

  @typedoc "`deadline_ms` and `started` (in native units) are monotonic times."
  @type t :: %__MODULE__{
          id: integer(),
          timeout_ms: pos_integer(),
          deadline_ms: integer(),
          started: integer(),
          cause: cause()
        }

  @type cause ::
          :requested | :shutdown | :failure | {:root | :topology | {:voucher, [atom()]}, :ended}

  @typedoc "The failure of a handler."
  @type error ::
          {:returned_error, term()}
          | {:exception, String.t()}
          | {:throw | :exit, term()}
          | {:timeout, pos_integer()}

  @type failure :: {path :: [atom()], error()}

  @doc "Creates a round with a run for each handler. No handler is called yet."
  @spec new(module(), pos_integer(), cause()) :: t()
  def new(robot, timeout_ms, cause) do
    id = System.unique_integer()
    Records.create_runs(robot, id, Records.handlers(robot))

    %__MODULE__{
      id: id,
      timeout_ms: timeout_ms,
      deadline_ms: System.monotonic_time(:millisecond) + timeout_ms,
      started: System.monotonic_time(),
      cause: cause
    }
  end

  @doc """
  Calls the handlers that are not called yet and monitors those that run. Returns the runs without
  an outcome, by their monitors.
  """
  @spec continue(t(), module()) :: %{reference() => Records.run_key()}
  def continue(round, robot) do
    for {key, _holder, nil, _handler} = run <- Records.runs(robot, round.id),
        into: %{},
        do: {watch(run), key}
  end

  @doc """
  Handles the end of a process that ran a handler. Returns `:done`, or the monitor of the process
  that runs the handler now.
  """
  @spec handle_down(Records.run_key(), pid(), term()) :: :done | reference()
  def handle_down(key, pid, reason) do
    case Records.run(key) do
      {_key, ^pid, nil, _handler} ->
        Records.put_outcome(key, {:error, {:exit, reason}})
        :done

      {_key, _holder, nil, _handler} = run ->
        watch(run)

      _settled ->
        :done
    end
  end

  defp watch({key, :nobody, nil, {_, _owner, module, opts, _id}}) do
    {_pid, ref} = spawn_monitor(__MODULE__, :run, [key, module, opts])
    ref
  end

  defp watch({_key, holder, nil, _handler}), do: Process.monitor(holder)

  @doc """
  Claims a run, unless another process has claimed it, calls the handler and writes the outcome.
  """
  @spec run(Records.run_key(), module(), keyword()) :: boolean()
  def run(key, module, opts),
    do: Records.claim(key) and Records.put_outcome(key, call(module, opts))

  @doc """
  Closes a round and returns its failures, by path.

  Kills handlers that have not returned, which counts as a failure. Removes a handler that has
  returned `:ok` if the process that registered it has ended.
  """
  @spec close(t(), module()) :: [failure()]
  def close(round, robot) do
    Enum.flat_map(Records.runs(robot, round.id), fn {_key, _holder, _outcome, handler} = run ->
      case outcome(run, round.timeout_ms) do
        :ok ->
          Records.release(handler)
          []

        {:error, error} ->
          [{path(handler), error}]
      end
    end)
  end

  defp outcome({_key, holder, nil, _handler}, timeout_ms) do
    if is_pid(holder), do: Process.exit(holder, :kill)
    {:error, {:timeout, timeout_ms}}
  end

  defp outcome({_key, _holder, outcome, _handler}, _timeout_ms), do: outcome

  defp path({{:handler, _robot, path}, _owner, _module, _opts, _id}), do: path

  defp call(module, opts) do
    case module.disarm(opts) do
      :ok -> :ok
      {:error, reason} -> {:error, {:returned_error, Callback.showable(reason)}}
      other -> {:error, {:returned_error, {:bad_return_value, Callback.showable(other)}}}
    end
  catch
    :error, reason -> {:error, {:exception, message(reason, __STACKTRACE__)}}
    kind, reason -> {:error, {kind, Callback.showable(reason)}}
  end

  # A user's code may compute the message of an exception.
  defp message(reason, stacktrace) do
    :error
    |> Exception.normalize(reason, stacktrace)
    |> Callback.showable()
    |> Exception.message()
  end
end

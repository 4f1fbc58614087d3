defmodule BB.Safety.Round do
  @moduledoc """
  One disarming: all handlers at once, each in a process of its own, until a common deadline.

  Each handler has a row in `BB.Safety.Records`: its turn. A process takes the turn before it calls
  the handler, which only one can do, and leaves the outcome there. So whoever continues a round,
  because the process that began it died, finds what was done, waits for what is being done, and
  calls no handler twice.
  """

  alias BB.Callback
  alias BB.Safety.Records

  @enforce_keys [:id, :timeout_ms, :deadline_ms, :started]
  defstruct [:id, :timeout_ms, :deadline_ms, :started, :cause]

  @typedoc "`deadline_ms` and `started` (native units) are monotonic times; `cause` is what led to it."
  @type t :: %__MODULE__{
          id: integer(),
          timeout_ms: pos_integer(),
          deadline_ms: integer(),
          started: integer(),
          cause: cause()
        }

  @type cause :: :requested | :shutdown | {:root | :topology | {:voucher, [atom()]}, :ended}

  @typedoc "Why a handler failed."
  @type error ::
          {:returned_error, term()}
          | {:exception, String.t()}
          | {:throw | :exit, term()}
          | {:timeout, pos_integer()}

  @type failure :: {path :: [atom()], error()}

  @doc "A round that begins now. Its handlers have their turns, none is called yet."
  @spec new(module(), pos_integer(), cause()) :: t()
  def new(robot, timeout_ms, cause) do
    id = System.unique_integer()
    Records.prepare(robot, id, Records.handlers(robot))

    %__MODULE__{
      id: id,
      timeout_ms: timeout_ms,
      deadline_ms: System.monotonic_time(:millisecond) + timeout_ms,
      started: System.monotonic_time(),
      cause: cause
    }
  end

  @doc "Calls what is not yet called and watches what is: the runs that have no outcome, by their monitors."
  @spec go_on(t(), module()) :: %{reference() => Records.run_key()}
  def go_on(round, robot) do
    for {key, _holder, nil, _handler} = run <- Records.runs(robot, round.id),
        into: %{},
        do: {watch(run), key}
  end

  @doc "A process that ran a handler has ended: `:done`, or the monitor of the process that runs it now."
  @spec ended(Records.run_key(), pid(), term()) :: :done | reference()
  def ended(key, pid, reason) do
    case Records.run(key) do
      {_key, ^pid, nil, _handler} ->
        Records.settle(key, {:error, {:exit, reason}})
        :done

      {_key, _holder, nil, _handler} = run ->
        watch(run)

      _settled ->
        :done
    end
  end

  defp watch({key, :nobody, nil, {_, _owner, module, opts, _id}}) do
    {_pid, ref} = spawn_monitor(__MODULE__, :work, [key, module, opts])
    ref
  end

  defp watch({_key, holder, nil, _handler}), do: Process.monitor(holder)

  @doc "Takes a handler's turn, unless another process has it, calls the handler and leaves the outcome."
  @spec work(Records.run_key(), module(), keyword()) :: boolean()
  def work(key, module, opts), do: Records.claim(key) and Records.settle(key, call(module, opts))

  @doc """
  Ends a round: its failures, by path. Handlers that are not done by now are killed and count as
  failures. Those that were done without a failure, and whose process has ended, are handlers no
  longer.
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

  # The message of an exception is code of a user's too.
  defp message(reason, stacktrace) do
    :error
    |> Exception.normalize(reason, stacktrace)
    |> Callback.showable()
    |> Exception.message()
  end
end

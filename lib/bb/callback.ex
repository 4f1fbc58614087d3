defmodule BB.Callback do
  @moduledoc """
  Calls a user's function in a process of its own, bounded in time and memory, so that its failure
  harms no other process.

  Use it for user code that has to run outside the user's own process: the optional callbacks of a
  driver (`c:BB.Sensor.explain/1`, `c:BB.Sensor.rate/1`, …), the checks of its options, telemetry
  handlers. `test/architecture_test.exs` finds such calls elsewhere.

      iex> BB.Callback.call({String, :to_integer, ["7"]})
      {:ok, 7}
      iex> {:error, {:raised, text}} =
      ...>   BB.Callback.call({String, :to_integer, ["seven"]}, quiet: true)
      iex> text =~ "ArgumentError"
      true

  Whatever the function does, the caller gets `{:ok, value}` or `{:error, failure}`
  (`t:failure/0`) within the time limit, and nothing else: no exit, no message, no process left
  over.

    * An exception, a throw or an exit is a failure, described in text. So is a return value other
      than the expected one.
    * The function's process is killed, with the processes linked to it, when it exceeds the time
      limit or 32 MB of memory, or when its caller ends.
    * A function that has exceeded the time limit is not called again for a minute: calls fail at
      once. So the callbacks of many sensors that hang take the time of one.
    * The failure of a function is logged once in ten minutes, whatever the number of its callers
      and calls.

  A call takes about 5 µs. Code that runs for each message, such as an encoding, runs in the
  process of its component instead, the only one that it can harm.
  """

  require Logger

  alias BB.Callback.Failures

  @timeout_ms 1_000
  @heap_bytes 32_000_000
  @longest_text 300

  @enforce_keys [:name, :timeout_ms]
  defstruct [:name, :timeout_ms, :monitor, :expected, :instead, quiet?: false, remember?: true]

  @typedoc "A call that has been started."
  @opaque t :: %__MODULE__{}

  @typedoc "The name of the called function for the log and for remembering failures, or a text."
  @type name :: {module(), atom(), arity()} | String.t()

  @typedoc """
  The reason why a call returned no value. `:no_clause` occurs only with the option `partial:`.
  """
  @type failure ::
          {:raised | :threw | :exited | :returned, text :: String.t()}
          | {:timeout, pos_integer()}
          | :no_clause

  @typedoc """
  An option of a call:

    * `name:` - the name of the call, the function's own by default
    * `accept:` - a function that turns the returned term into `{:ok, value}`, or returns
      `:error`; it runs in the process of the call
    * `expected:` - a description of the accepted values, for errors
    * `instead:` - what the caller does without a value, for the log
    * `timeout_ms:` - the time limit, #{@timeout_ms} by default
    * `partial:` - whether the function may lack a clause for its arguments, which is not logged
    * `remember:` - `false` to call a function again although it exceeded the time limit before
    * `quiet:` - `true` if the caller reports the failure itself
  """
  @type option ::
          {:name, name()}
          | {:accept, (term() -> {:ok, term()} | :error)}
          | {:expected, String.t()}
          | {:instead, String.t()}
          | {:timeout_ms, pos_integer()}
          | {:partial, boolean()}
          | {:remember, boolean()}
          | {:quiet, boolean()}

  @doc "Calls a function and waits for its result."
  @spec call({module(), atom(), [term()]}, [option()]) :: {:ok, term()} | {:error, failure()}
  def call(mfa, opts \\ []), do: mfa |> start(opts) |> await()

  @doc """
  Starts a call, to be awaited with `await/1` by the same process. Several calls run at the same
  time.
  """
  @spec start({module(), atom(), [term()]}, [option()]) :: t()
  def start({module, function, arguments} = mfa, opts \\ []) do
    call = %__MODULE__{
      name: opts[:name] || {module, function, length(arguments)},
      timeout_ms: opts[:timeout_ms] || @timeout_ms,
      expected: opts[:expected],
      instead: opts[:instead],
      quiet?: Keyword.get(opts, :quiet, false),
      remember?: Keyword.get(opts, :remember, true)
    }

    if call.remember? and Failures.hung?(call.name), do: call, else: spawn_call(call, mfa, opts)
  end

  defp spawn_call(call, mfa, opts) do
    accept = opts[:accept] || (&{:ok, &1})
    work = {mfa, accept, Keyword.get(opts, :partial, false)}
    {_pid, monitor} = spawn_monitor(__MODULE__, :oversee, [self(), work, call.timeout_ms])
    %{call | monitor: monitor}
  end

  @doc "Waits for the result of a started call."
  @spec await(t()) :: {:ok, term()} | {:error, failure()}
  def await(%__MODULE__{monitor: nil} = call), do: {:error, {:timeout, call.timeout_ms}}

  def await(%__MODULE__{monitor: monitor} = call) do
    receive do
      {:DOWN, ^monitor, :process, _pid, {__MODULE__, {:ok, value}}} ->
        {:ok, value}

      {:DOWN, ^monitor, :process, _pid, {__MODULE__, {:error, failure}}} ->
        handle_failure(call, failure)

      {:DOWN, ^monitor, :process, _pid, reason} ->
        handle_failure(call, {:exited, format_exit(reason)})
    end
  end

  defp handle_failure(_call, :no_clause), do: {:error, :no_clause}

  defp handle_failure(call, failure) do
    if call.remember? and match?({:timeout, _ms}, failure), do: Failures.put_hung(call.name)
    unless call.quiet?, do: log_failure(call, failure)
    {:error, failure}
  end

  defp log_failure(call, failure) do
    if Failures.log?(call.name),
      do:
        Logger.warning([
          format_name(call.name),
          " ",
          format_failure(failure, call.expected),
          if(call.instead, do: ["; ", call.instead], else: []),
          ". This is logged at most once in ten minutes."
        ])
  end

  defp format_name({module, function, arity}), do: Exception.format_mfa(module, function, arity)
  defp format_name(text), do: text

  @doc """
  Returns a failure as text that follows the name of the function.

      iex> BB.Callback.format_failure({:timeout, 1_000})
      "did not return within 1000 ms"
      iex> BB.Callback.format_failure({:returned, ":fast"}, "a number or nil")
      "was expected to return a number or nil, got: :fast"
  """
  @spec format_failure(failure(), expected :: String.t() | nil) :: String.t()
  def format_failure(failure, expected \\ nil)
  def format_failure({:timeout, timeout_ms}, _), do: "did not return within #{timeout_ms} ms"
  def format_failure(:no_clause, _), do: "has no clause for its arguments"
  def format_failure({:returned, text}, nil), do: "returned #{text}"

  def format_failure({:returned, text}, expected),
    do: "was expected to return #{expected}, got: #{text}"

  def format_failure({:raised, text}, _), do: "raised #{text}"
  def format_failure({:threw, text}, _), do: "threw #{text}"
  def format_failure({:exited, text}, _), do: "exited with #{text}"

  @doc false
  @deprecated "Use BB.Callback.format_failure/2"
  @spec words(failure(), expected :: String.t() | nil) :: String.t()
  def words(failure, expected \\ nil), do: format_failure(failure, expected)

  @doc """
  Returns the term, or an exception in its place if the term cannot be shown.

  A term cannot be shown if it contains an exception whose message, or a struct whose `Inspect`
  implementation, raises, throws or exits. Use it for terms that will be logged: Erlang's logger
  removes a handler that fails at one. It runs in the calling process.

      iex> BB.Callback.showable(%RuntimeError{message: "no answer"})
      %RuntimeError{message: "no answer"}
  """
  @spec showable(term()) :: term()
  def showable(term) do
    _ = is_exception(term) and Exception.message(term)
    _ = Exception.format_exit(term)
    _ = inspect(term)
    term
  catch
    _kind, _reason -> RuntimeError.exception("#{describe(term)} that cannot be shown")
  end

  defp describe(%{__struct__: module}), do: inspect(module)
  defp describe(_term), do: "a term"

  # The process between caller and worker. It ends with the call or the caller, and ends the
  # worker.

  @doc false
  def oversee(caller, work, timeout_ms) do
    Process.flag(:trap_exit, true)
    monitor = Process.monitor(caller)
    worker = :erlang.spawn_opt(__MODULE__, :work, [self(), work], [:link, heap_limit()])

    outcome =
      receive do
        {^worker, outcome} -> outcome
        {:EXIT, ^worker, reason} -> {:error, {:exited, format_exit(reason)}}
        {:DOWN, ^monitor, :process, _pid, _reason} -> :caller_ended
      after
        timeout_ms -> {:error, {:timeout, timeout_ms}}
      end

    Process.exit(worker, :kill)
    exit({__MODULE__, outcome})
  end

  defp heap_limit do
    size = div(@heap_bytes, :erlang.system_info(:wordsize))
    {:max_heap_size, %{size: size, kill: true, error_logger: false}}
  end

  defp format_exit(:killed),
    do: ":killed (by another process, or for using over #{div(@heap_bytes, 1_000_000)} MB)"

  # The Inspect implementation of a struct may be user code.
  defp format_exit(reason), do: format_term(reason, structs: false)

  # The worker, in which the function runs

  @doc false
  def work(overseer, work), do: send(overseer, {self(), apply_function(work)})

  defp apply_function({{module, function, arguments}, accept, partial?}) do
    value = apply(module, function, arguments)
    with :error <- accept.(value), do: {:error, {:returned, format_term(value)}}
  catch
    :error, :function_clause when partial? ->
      {:error, clause_failure(function, length(arguments), __STACKTRACE__)}

    :error, reason ->
      {:error, {:raised, format_error(reason, __STACKTRACE__)}}

    :throw, value ->
      {:error, {:threw, format_term(value)}}

    :exit, reason ->
      {:error, {:exited, format_term(reason)}}
  end

  # Also if the function delegates to one of the same name.
  defp clause_failure(function, arity, [{_module, function, arguments, _} | _])
       when length(arguments) == arity,
       do: :no_clause

  defp clause_failure(_function, _arity, stacktrace),
    do: {:raised, format_error(:function_clause, stacktrace)}

  # The message of an exception and the Inspect implementation of a struct may be user code.

  defp format_error(reason, stacktrace) do
    exception = Exception.normalize(:error, reason, stacktrace)
    text = "#{inspect(exception.__struct__)}: #{Exception.message(exception)}"
    truncate(text) <> format_place(stacktrace)
  catch
    _kind, _reason -> "an exception whose message cannot be shown" <> format_place(stacktrace)
  end

  defp format_place([{_, _, _, _} = entry | _]),
    do: " (#{truncate(Exception.format_stacktrace_entry(entry))})"

  defp format_place(_stacktrace), do: ""

  defp format_term(term, opts \\ []) do
    term |> inspect([limit: 20, printable_limit: @longest_text] ++ opts) |> truncate()
  catch
    _kind, _reason -> "a term that cannot be shown"
  end

  defp truncate(text) do
    if String.length(text) > @longest_text,
      do: String.slice(text, 0, @longest_text) <> "…",
      else: text
  end
end

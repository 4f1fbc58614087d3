defmodule BB.Callback do
  @moduledoc """
  Calls code of others so that it can hurt only itself: the optional callbacks of a driver
  (`c:BB.Sensor.explain/1`, `c:BB.Sensor.rate/1`, …), the checks of its options, telemetry
  handlers. Whatever of a user's has to be called outside the user's own process is called from
  here, and `test/architecture_test.exs` finds what is not.

      iex> BB.Callback.call({String, :to_integer, ["7"]})
      {:ok, 7}
      iex> {:error, {:raised, words}} = BB.Callback.call({String, :to_integer, ["seven"]}, quiet: true)
      iex> words =~ "ArgumentError"
      true

  The function runs in a process of its own. Whatever it does, the caller gets `{:ok, value}` or
  `{:error, failure}` (`t:failure/0`) within the limit of time, and nothing else: no exit, no
  message, no process that stays.

    * What it raises, throws or exits with is a failure, in words. So is a value that is not what
      was expected.
    * When it does not return in time it is killed, with what is linked to it, and so it is when
      its caller ends, or when it takes more memory than 32 MB.
    * A function that did not return is not called again for a minute: the same failure comes at
      once. So many sensors whose callbacks hang take the time of one.
    * Each function's failure is logged once in ten minutes, whoever calls it and however often.

  A call takes some 5 µs. What happens for each message, such as an encoding, runs in its
  component's own process instead, which it alone can hurt.
  """

  require Logger

  alias BB.Callback.Failures

  @timeout_ms 1_000
  @heap_bytes 32_000_000
  @longest_words 300

  @enforce_keys [:name, :timeout_ms]
  defstruct [:name, :timeout_ms, :monitor, :expected, :instead, quiet?: false, remember?: true]

  @typedoc "A call that has begun."
  @opaque t :: %__MODULE__{}

  @typedoc "What is called, for the log and to remember it by: a function of a module, or words."
  @type name :: {module(), atom(), arity()} | String.t()

  @typedoc """
  Why there is no value. `:no_clause` is for functions that need not have one (`partial:`).
  """
  @type failure ::
          {:raised | :threw | :exited | :returned, words :: String.t()}
          | {:timeout, pos_integer()}
          | :no_clause

  @typedoc """
  How it is called:

    * `name:` - when it is not the called function's
    * `accept:` - turns what was returned into `{:ok, value}`, or `:error` when it is none; runs
      in the process of the call
    * `expected:` - what would be accepted, in words
    * `instead:` - what happens without a value, in words for the log
    * `timeout_ms:` - #{@timeout_ms} when not given
    * `partial:` - whether it may lack a clause for its arguments, which is nothing to log
    * `remember:` - `false` for a function that is called again although it did not return the
      last time
    * `quiet:` - `true` when the caller says itself that it failed
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

  @doc "Calls a function and waits for what it returns."
  @spec call({module(), atom(), [term()]}, [option()]) :: {:ok, term()} | {:error, failure()}
  def call(mfa, opts \\ []), do: mfa |> start(opts) |> await()

  @doc """
  Begins a call, for `await/1` of the same process: several calls take the time of the longest.
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

    if call.remember? and Failures.hung?(call.name), do: call, else: begin(call, mfa, opts)
  end

  defp begin(call, mfa, opts) do
    accept = opts[:accept] || (&{:ok, &1})
    work = {mfa, accept, Keyword.get(opts, :partial, false)}
    {_pid, monitor} = spawn_monitor(__MODULE__, :oversee, [self(), work, call.timeout_ms])
    %{call | monitor: monitor}
  end

  @doc "What came of a call: its value, or why there is none."
  @spec await(t()) :: {:ok, term()} | {:error, failure()}
  def await(%__MODULE__{monitor: nil} = call), do: {:error, {:timeout, call.timeout_ms}}

  def await(%__MODULE__{monitor: monitor} = call) do
    receive do
      {:DOWN, ^monitor, :process, _pid, {__MODULE__, {:ok, value}}} -> {:ok, value}
      {:DOWN, ^monitor, :process, _pid, {__MODULE__, {:error, failure}}} -> fail(call, failure)
      {:DOWN, ^monitor, :process, _pid, reason} -> fail(call, {:exited, plain(reason)})
    end
  end

  defp fail(_call, :no_clause), do: {:error, :no_clause}

  defp fail(call, failure) do
    if call.remember? and match?({:timeout, _ms}, failure), do: Failures.put_hung(call.name)
    unless call.quiet?, do: say(call, failure)
    {:error, failure}
  end

  defp say(call, failure) do
    if Failures.news?(call.name),
      do:
        Logger.warning([
          title(call.name),
          " ",
          words(failure, call.expected),
          if(call.instead, do: ["; ", call.instead], else: []),
          ". This is said at most once in ten minutes."
        ])
  end

  defp title({module, function, arity}), do: Exception.format_mfa(module, function, arity)
  defp title(words), do: words

  @doc """
  A failure in words.

      iex> BB.Callback.words({:timeout, 1_000})
      "did not return within 1000 ms"
      iex> BB.Callback.words({:returned, ":fast"}, "a number or nil")
      "was expected to return a number or nil, got: :fast"
  """
  @spec words(failure(), expected :: String.t() | nil) :: String.t()
  def words(failure, expected \\ nil)
  def words({:timeout, timeout_ms}, _), do: "did not return within #{timeout_ms} ms"
  def words(:no_clause, _), do: "has no clause for its arguments"
  def words({:returned, shown}, nil), do: "returned #{shown}"

  def words({:returned, shown}, expected),
    do: "was expected to return #{expected}, got: #{shown}"

  def words({:raised, shown}, _), do: "raised #{shown}"
  def words({:threw, shown}, _), do: "threw #{shown}"
  def words({:exited, shown}, _), do: "exited with #{shown}"

  @doc """
  A term itself, or a sentence in its place where it cannot be shown: an exception whose message, or
  a struct whose `Inspect`, throws or exits. For what others will show, the log above all: Erlang's
  logger takes away a handler that fails at it. It runs in the calling process.

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
    _kind, _reason -> RuntimeError.exception("#{kind(term)} that cannot be shown")
  end

  defp kind(%{__struct__: module}), do: inspect(module)
  defp kind(_term), do: "a term"

  # The process between: it outlives neither the call nor the caller, and nothing outlives it.

  @doc false
  def oversee(caller, work, timeout_ms) do
    Process.flag(:trap_exit, true)
    monitor = Process.monitor(caller)
    worker = :erlang.spawn_opt(__MODULE__, :work, [self(), work], [:link, heap_limit()])

    outcome =
      receive do
        {^worker, outcome} -> outcome
        {:EXIT, ^worker, reason} -> {:error, {:exited, plain(reason)}}
        {:DOWN, ^monitor, :process, _pid, _reason} -> :nobody_waits
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

  defp plain(:killed),
    do: ":killed: it was killed, or took more than #{div(@heap_bytes, 1_000_000)} MB"

  # How a struct is shown may be code of others.
  defp plain(reason), do: shown(reason, structs: false)

  # The process of the call

  @doc false
  def work(overseer, work), do: send(overseer, {self(), attempt(work)})

  defp attempt({{module, function, arguments}, accept, partial?}) do
    value = apply(module, function, arguments)
    with :error <- accept.(value), do: {:error, {:returned, shown(value)}}
  catch
    :error, :function_clause when partial? ->
      {:error, unclaused(function, length(arguments), __STACKTRACE__)}

    :error, reason ->
      {:error, {:raised, raised(reason, __STACKTRACE__)}}

    :throw, value ->
      {:error, {:threw, shown(value)}}

    :exit, reason ->
      {:error, {:exited, shown(reason)}}
  end

  # Also when it hands on to a function of the same name.
  defp unclaused(function, arity, [{_module, function, arguments, _} | _])
       when length(arguments) == arity,
       do: :no_clause

  defp unclaused(_function, _arity, stacktrace),
    do: {:raised, raised(:function_clause, stacktrace)}

  # An exception's message, and how a term is shown, may be code of others too.

  defp raised(reason, stacktrace) do
    exception = Exception.normalize(:error, reason, stacktrace)
    clip("#{inspect(exception.__struct__)}: #{Exception.message(exception)}") <> at(stacktrace)
  catch
    _kind, _reason -> "an exception whose message cannot be had" <> at(stacktrace)
  end

  defp at([{_, _, _, _} = entry | _]), do: " (#{clip(Exception.format_stacktrace_entry(entry))})"
  defp at(_stacktrace), do: ""

  defp shown(term, opts \\ []) do
    term |> inspect([limit: 20, printable_limit: @longest_words] ++ opts) |> clip()
  catch
    _kind, _reason -> "a term that cannot be shown"
  end

  defp clip(text) do
    if String.length(text) > @longest_words,
      do: String.slice(text, 0, @longest_words) <> "…",
      else: text
  end
end

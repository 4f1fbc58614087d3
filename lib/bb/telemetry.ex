defmodule BB.Telemetry do
  @moduledoc """
  Emits events with measurements, and calls the handlers attached to them.

  Attach a handler to measure a robot, such as the ticks that a loop skips; emit events from code
  that others may want to measure:

      iex> test = self()
      iex> handler = fn _event, measurements, _metadata, _config -> send(test, measurements) end
      iex> BB.Telemetry.attach("doc", [:my_robot, :grip], handler, nil)
      :ok
      iex> BB.Telemetry.emit([:my_robot, :grip], %{force: 2.5}, %{})
      :ok
      iex> receive do measurements -> measurements end
      %{force: 2.5}
      iex> BB.Telemetry.detach("doc")
      :ok

  The conventions are those of the `:telemetry` library. An event is a list of atoms, with a map
  of measurements and a map of metadata. A handler is a function that runs in the emitting
  process, so it should be fast and leave long work to a process of its own.

  A handler that fails is detached and the error is logged, so that a measurement never breaks
  what it measures. Captures of named functions are faster than anonymous functions.

  Handlers of the robot's own events (`apart: true`) run in processes of their own (`BB.Callback`)
  while the emitting process waits. A handler that hangs or kills its process delays the emitting
  one by a second, once. The metadata contains what a handler needs of the emitting process.

  Events are also passed to `:telemetry` if that library is loaded, so that dashboards made for it
  receive them. An event without handlers costs a lookup.
  """

  require Logger

  alias BB.Callback

  @type event :: [atom()]
  @type measurements :: map()
  @type metadata :: map()
  @type config :: term()
  @type handler_id :: term()
  @type handler :: (event(), measurements(), metadata(), config() -> any())

  @index {__MODULE__, :index}
  @lock :"BB.Telemetry lock"

  @doc """
  Attaches a handler to an event.

  Each time the event is emitted, `function` is called with the event, its measurements, its
  metadata and `config`. Returns `{:error, :already_exists}` if a handler has this id already.
  """
  @spec attach(handler_id(), event(), handler(), config()) :: :ok | {:error, :already_exists}
  def attach(id, event, function, config), do: attach_many(id, [event], function, config)

  @doc "Attaches a handler as `attach/4` does, to several events under one id."
  @spec attach_many(handler_id(), [event()], handler(), config()) ::
          :ok | {:error, :already_exists}
  def attach_many(id, events, function, config) when is_function(function, 4) do
    Enum.each(events, &check_event!/1)

    update_index(fn index ->
      if is_map_key(index, id) do
        {:error, :already_exists}
      else
        for event <- events, do: put(event, handlers(event) ++ [{id, function, config}])
        :persistent_term.put(@index, Map.put(index, id, events))
      end
    end)
  end

  def attach_many(_id, _events, function, _config) do
    raise ArgumentError,
          "expected a function of 4 arguments as telemetry handler, got: #{inspect(function)}"
  end

  @doc "Removes a handler. Returns `{:error, :not_found}` if no handler has this id."
  @spec detach(handler_id()) :: :ok | {:error, :not_found}
  def detach(id) do
    update_index(fn index ->
      case Map.pop(index, id) do
        {nil, _} ->
          {:error, :not_found}

        {events, index} ->
          for event <- events, do: put(event, List.keydelete(handlers(event), id, 0))
          :persistent_term.put(@index, index)
      end
    end)
  end

  @doc """
  Emits an event: calls its handlers one after the other in the calling process.

  With `apart: true` each handler runs in a process of its own, for a second at most. Use it in
  processes on which others depend.
  """
  @spec emit(event(), measurements(), metadata(), apart: boolean()) :: :ok
  def emit(event, measurements, metadata \\ %{}, opts \\ [])
      when is_map(measurements) and is_map(metadata) do
    call = if opts[:apart], do: &call_apart/2, else: &call/2
    for handler <- handlers(event), do: call.(handler, [event, measurements, metadata])
    forward([event, measurements, metadata], opts[:apart])
  end

  @doc """
  Runs `function` and emits events at its start and its end.

  `function` returns `{result, stop_metadata}` or `{result, measurements, stop_metadata}`, and
  `span/3` returns the result. The events are:

    * `prefix ++ [:start]` with `monotonic_time` and `system_time`
    * `prefix ++ [:stop]`, or `prefix ++ [:exception]` if the function raises, throws or exits,
      with `duration` and `monotonic_time`

  All times are in native units. The metadata of all events has a `telemetry_span_context`, the
  same for one call. That of an exception has `kind`, `reason` and `stacktrace`. The options are
  those of `emit/4`.
  """
  @spec span(
          event(),
          metadata(),
          (() -> {result, metadata()} | {result, measurements(), metadata()}),
          apart: boolean()
        ) :: result
        when result: var
  def span(prefix, metadata, function, opts \\ []) when is_function(function, 0) do
    start = System.monotonic_time()
    metadata = Map.put_new(metadata, :telemetry_span_context, make_ref())

    emit(
      prefix ++ [:start],
      %{monotonic_time: start, system_time: System.system_time()},
      metadata,
      opts
    )

    try do
      function.()
    catch
      kind, reason ->
        error = %{kind: kind, reason: reason, stacktrace: __STACKTRACE__}
        emit(prefix ++ [:exception], elapsed_since(start), Map.merge(metadata, error), opts)
        :erlang.raise(kind, reason, __STACKTRACE__)
    else
      {result, stop} -> emit_stop(prefix, start, %{}, metadata, stop, opts, result)
      {result, more, stop} -> emit_stop(prefix, start, more, metadata, stop, opts, result)
    end
  end

  defp emit_stop(prefix, start, more, metadata, stop_metadata, opts, result) do
    measurements = Map.merge(more, elapsed_since(start))
    context = Map.take(metadata, [:telemetry_span_context])
    emit(prefix ++ [:stop], measurements, Map.merge(context, stop_metadata), opts)
    result
  end

  defp elapsed_since(start) do
    now = System.monotonic_time()
    %{duration: now - start, monotonic_time: now}
  end

  # Handlers in the emitting process

  defp call({id, function, config}, [event | _] = arguments) do
    apply(function, arguments ++ [config])
  catch
    kind, reason -> detach_failed(id, event, Exception.format(kind, reason, __STACKTRACE__))
  end

  # Handlers in processes of their own

  defp call_apart({id, function, config}, [event | _] = arguments) do
    call = {:erlang, :apply, [function, arguments ++ [config]]}

    opts = [accept: &accept_any/1, remember: false, quiet: true]

    with {:error, failure} <- Callback.call(call, opts),
         do: detach_failed(id, event, "the handler " <> Callback.format_failure(failure))
  end

  defp accept_any(_result), do: {:ok, :done}

  defp detach_failed(id, event, reason) do
    with :ok <- detach(id) do
      Logger.error(
        "Telemetry handler #{inspect(id)} failed at #{inspect(event)} and was detached: #{reason}"
      )
    end
  end

  # The library may be missing, so it is called by name.
  defp forward(arguments, apart?) do
    if :erlang.function_exported(:telemetry, :execute, 3), do: execute(arguments, apart?)
    :ok
  end

  defp execute(arguments, true) do
    Callback.call({:telemetry, :execute, arguments},
      accept: &accept_any/1,
      instead: "some :telemetry handlers did not get the event"
    )
  end

  defp execute(arguments, _apart?), do: apply(:telemetry, :execute, arguments)

  defp handlers(event), do: :persistent_term.get({__MODULE__, event}, [])

  defp put(event, []), do: :persistent_term.erase({__MODULE__, event})
  defp put(event, handlers), do: :persistent_term.put({__MODULE__, event}, handlers)

  # Changes of handlers are rare and made one at a time; reading takes no lock. A process of its
  # own makes the change while it holds a registered name. Others wait for its end, so that
  # neither a crash nor a delay of the caller keeps the name.
  defp update_index(update) do
    {_pid, monitor} = spawn_monitor(fn -> exit({__MODULE__, update_locked(update)}) end)

    receive do
      {:DOWN, ^monitor, :process, _pid, {__MODULE__, result}} -> result
      {:DOWN, ^monitor, :process, _pid, reason} -> exit(reason)
    end
  end

  defp update_locked(update) do
    if lock?(), do: update.(:persistent_term.get(@index, %{})), else: await_lock(update)
  end

  defp await_lock(update) do
    monitor = Process.monitor(@lock)
    receive do: ({:DOWN, ^monitor, :process, _holder, _reason} -> update_locked(update))
  end

  defp lock? do
    Process.register(self(), @lock)
  rescue
    ArgumentError -> false
  end

  defp check_event!([_ | _] = event) do
    if Enum.all?(event, &is_atom/1), do: :ok, else: raise_event(event)
  end

  defp check_event!(event), do: raise_event(event)

  defp raise_event(event),
    do:
      raise(ArgumentError, "expected a telemetry event, a list of atoms, got: #{inspect(event)}")
end

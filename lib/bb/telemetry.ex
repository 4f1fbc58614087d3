defmodule BB.Telemetry do
  @moduledoc """
  What the robot's parts tell of themselves, to whoever wants to measure them.

  The conventions are those of the `:telemetry` library: an event is a list of atoms, with a map of measurements and a map of
  metadata; a handler is a function that runs in the process that emits, so it should be quick and send what takes longer to a
  process of its own.

      BB.Telemetry.attach("slow-ticks", [:bb, :loop, :tick], &MyRobot.Watch.tick/4, nil)

      def tick(_event, %{skipped: skipped}, metadata, _config) when skipped > 0, do: …

  A handler that fails is detached, and an error is logged: a measurement never breaks what it
  measures. Captures of named functions are faster than anonymous ones.

  The events of the robot's own parts (`apart: true`) have handlers called in processes of their
  own (`BB.Callback`), while the emitting process waits: one that hangs, or kills its process,
  costs it a second, once. What a handler needs of the emitting process is in the metadata.

  Events are also handed on to `:telemetry` when that library is loaded, so that a dashboard made for it sees them. An event
  that nobody handles costs a look-up.
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
  @turn :"BB.Telemetry turn"

  @doc """
  Calls `function` with the event, its measurements, its metadata and `config`, each time that the event is emitted.

  `{:error, :already_exists}` when there is a handler with this id.
  """
  @spec attach(handler_id(), event(), handler(), config()) :: :ok | {:error, :already_exists}
  def attach(id, event, function, config), do: attach_many(id, [event], function, config)

  @doc "Like `attach/4`, for several events at once, under one id."
  @spec attach_many(handler_id(), [event()], handler(), config()) ::
          :ok | {:error, :already_exists}
  def attach_many(id, events, function, config) when is_function(function, 4) do
    Enum.each(events, &check_event!/1)

    changing(fn index ->
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
          "a telemetry handler is a function of 4 arguments, got: #{inspect(function)}"
  end

  @doc "Removes a handler. `{:error, :not_found}` when there is none with this id."
  @spec detach(handler_id()) :: :ok | {:error, :not_found}
  def detach(id) do
    changing(fn index ->
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
  Emits an event: calls its handlers, one after the other, in the calling process.

  With `apart: true` each is called in a process of its own and has a second for it: for processes
  on which others depend.
  """
  @spec emit(event(), measurements(), metadata(), apart: boolean()) :: :ok
  def emit(event, measurements, metadata \\ %{}, opts \\ [])
      when is_map(measurements) and is_map(metadata) do
    call = if opts[:apart], do: &call_apart/2, else: &call/2
    for handler <- handlers(event), do: call.(handler, [event, measurements, metadata])
    hand_on([event, measurements, metadata], opts[:apart])
  end

  @doc """
  Runs `function` and tells of its beginning and its end.

  `function` returns `{result, stop_metadata}` or `{result, measurements, stop_metadata}`, and `span/3` returns the result. The
  events are `prefix ++ [:start]` with `monotonic_time` and `system_time`, and `prefix ++ [:stop]`, or `prefix ++ [:exception]`
  when the function raises, throws or exits, with `duration` and `monotonic_time`, all in native units. The metadata of all of
  them has a `telemetry_span_context`, the same for one call; an exception's has `kind`, `reason` and `stacktrace`.
  Options are those of `emit/4`.
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
        emit(prefix ++ [:exception], since(start), Map.merge(metadata, error), opts)
        :erlang.raise(kind, reason, __STACKTRACE__)
    else
      {result, stop} -> stop(prefix, start, %{}, metadata, stop, opts, result)
      {result, more, stop} -> stop(prefix, start, more, metadata, stop, opts, result)
    end
  end

  defp stop(prefix, start, more, metadata, stop_metadata, opts, result) do
    measurements = Map.merge(more, since(start))
    context = Map.take(metadata, [:telemetry_span_context])
    emit(prefix ++ [:stop], measurements, Map.merge(context, stop_metadata), opts)
    result
  end

  defp since(start) do
    now = System.monotonic_time()
    %{duration: now - start, monotonic_time: now}
  end

  # In the emitting process

  defp call({id, function, config}, [event | _] = arguments) do
    apply(function, arguments ++ [config])
  catch
    kind, reason -> dismiss(id, event, Exception.format(kind, reason, __STACKTRACE__))
  end

  # In a process of the call

  defp call_apart({id, function, config}, [event | _] = arguments) do
    call = {:erlang, :apply, [function, arguments ++ [config]]}

    with {:error, failure} <- Callback.call(call, accept: &done/1, remember: false, quiet: true),
         do: dismiss(id, event, "it " <> Callback.words(failure))
  end

  defp done(_whatever), do: {:ok, :done}

  defp dismiss(id, event, why) do
    with :ok <- detach(id) do
      Logger.error(
        "The telemetry handler #{inspect(id)} failed at #{inspect(event)} and is detached: #{why}"
      )
    end
  end

  # Called by name, because the library need not be there.
  defp hand_on(arguments, apart?) do
    if :erlang.function_exported(:telemetry, :execute, 3), do: execute(arguments, apart?)
    :ok
  end

  defp execute(arguments, true) do
    Callback.call({:telemetry, :execute, arguments},
      accept: &done/1,
      instead: "some of its handlers have not got the event"
    )
  end

  defp execute(arguments, _here), do: apply(:telemetry, :execute, arguments)

  defp handlers(event), do: :persistent_term.get({__MODULE__, event}, [])

  defp put(event, []), do: :persistent_term.erase({__MODULE__, event})
  defp put(event, handlers), do: :persistent_term.put({__MODULE__, event}, handlers)

  # One change at a time: handlers come and go seldom, and reading them takes no lock. Who has the
  # name makes its change; the others wait for its end, so that no crash and no delay keeps it.
  defp changing(change) do
    {_pid, monitor} = spawn_monitor(fn -> exit({__MODULE__, change(change)}) end)

    receive do
      {:DOWN, ^monitor, :process, _pid, {__MODULE__, result}} -> result
      {:DOWN, ^monitor, :process, _pid, reason} -> exit(reason)
    end
  end

  defp change(change) do
    if first?(), do: change.(:persistent_term.get(@index, %{})), else: change_after(change)
  end

  defp change_after(change) do
    monitor = Process.monitor(@turn)
    receive do: ({:DOWN, ^monitor, :process, _holder, _reason} -> change(change))
  end

  defp first? do
    Process.register(self(), @turn)
  rescue
    ArgumentError -> false
  end

  defp check_event!([_ | _] = event) do
    if Enum.all?(event, &is_atom/1), do: :ok, else: refuse_event(event)
  end

  defp check_event!(event), do: refuse_event(event)

  defp refuse_event(event),
    do: raise(ArgumentError, "a telemetry event is a list of atoms, got: #{inspect(event)}")
end

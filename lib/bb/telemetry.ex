defmodule BB.Telemetry do
  @moduledoc """
  What the robot's parts tell of themselves, to whoever wants to measure them.

  The conventions are those of the `:telemetry` library: an event is a list of atoms, with a map of measurements and a map of
  metadata; a handler is a function that runs in the process that emits, so it should be quick and send what takes longer to a
  process of its own.

      BB.Telemetry.attach("slow-ticks", [:bb, :loop, :tick], &MyRobot.Watch.tick/4, nil)

      def tick(_event, %{skipped: skipped}, metadata, _config) when skipped > 0, do: …

  A handler that raises is detached, and an error is logged: a measurement never breaks what it measures. Captures of named
  functions are faster than anonymous ones.

  Events are also handed on to `:telemetry` when that library is loaded, so that a dashboard made for it sees them. An event
  that nobody handles costs a look-up.
  """

  require Logger

  @type event :: [atom()]
  @type measurements :: map()
  @type metadata :: map()
  @type config :: term()
  @type handler_id :: term()
  @type handler :: (event(), measurements(), metadata(), config() -> any())

  @index {__MODULE__, :index}

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

  @doc "Emits an event: calls its handlers, one after the other, in the calling process."
  @spec emit(event(), measurements(), metadata()) :: :ok
  def emit(event, measurements, metadata \\ %{}) when is_map(measurements) and is_map(metadata) do
    for handler <- handlers(event), do: call(handler, event, measurements, metadata)
    hand_on(event, measurements, metadata)
  end

  @doc """
  Runs `function` and tells of its beginning and its end.

  `function` returns `{result, stop_metadata}` or `{result, measurements, stop_metadata}`, and `span/3` returns the result. The
  events are `prefix ++ [:start]` with `monotonic_time` and `system_time`, and `prefix ++ [:stop]`, or `prefix ++ [:exception]`
  when the function raises, throws or exits, with `duration` and `monotonic_time`, all in native units. The metadata of all of
  them has a `telemetry_span_context`, the same for one call; an exception's has `kind`, `reason` and `stacktrace`.
  """
  @spec span(
          event(),
          metadata(),
          (() -> {result, metadata()} | {result, measurements(), metadata()})
        ) :: result
        when result: var
  def span(prefix, metadata, function) when is_function(function, 0) do
    start = System.monotonic_time()
    metadata = Map.put_new(metadata, :telemetry_span_context, make_ref())

    emit(
      prefix ++ [:start],
      %{monotonic_time: start, system_time: System.system_time()},
      metadata
    )

    try do
      function.()
    catch
      kind, reason ->
        error = %{kind: kind, reason: reason, stacktrace: __STACKTRACE__}
        emit(prefix ++ [:exception], since(start), Map.merge(metadata, error))
        :erlang.raise(kind, reason, __STACKTRACE__)
    else
      {result, stop_metadata} -> stop(prefix, start, %{}, metadata, stop_metadata, result)
      {result, more, stop_metadata} -> stop(prefix, start, more, metadata, stop_metadata, result)
    end
  end

  defp stop(prefix, start, more, metadata, stop_metadata, result) do
    context = Map.take(metadata, [:telemetry_span_context])
    emit(prefix ++ [:stop], Map.merge(more, since(start)), Map.merge(context, stop_metadata))
    result
  end

  defp since(start) do
    now = System.monotonic_time()
    %{duration: now - start, monotonic_time: now}
  end

  defp call({id, function, config}, event, measurements, metadata) do
    function.(event, measurements, metadata, config)
  catch
    kind, reason ->
      _ = detach(id)

      Logger.error(
        "The telemetry handler #{inspect(id)} failed at #{inspect(event)} and is detached: " <>
          Exception.format(kind, reason, __STACKTRACE__)
      )
  end

  # Called by name, because the library need not be there; a captured function is not looked up by the compiler.
  defp hand_on(event, measurements, metadata) do
    if :erlang.function_exported(:telemetry, :execute, 3),
      do: Function.capture(:telemetry, :execute, 3).(event, measurements, metadata)

    :ok
  end

  defp handlers(event), do: :persistent_term.get({__MODULE__, event}, [])

  defp put(event, []), do: :persistent_term.erase({__MODULE__, event})
  defp put(event, handlers), do: :persistent_term.put({__MODULE__, event}, handlers)

  # One change at a time: handlers come and go seldom, and reading them takes no lock.
  defp changing(change) do
    :global.trans({__MODULE__, self()}, fn -> change.(:persistent_term.get(@index, %{})) end, [
      node()
    ])
  end

  defp check_event!([_ | _] = event) do
    if Enum.all?(event, &is_atom/1), do: :ok, else: refuse_event(event)
  end

  defp check_event!(event), do: refuse_event(event)

  defp refuse_event(event),
    do: raise(ArgumentError, "a telemetry event is a list of atoms, got: #{inspect(event)}")
end

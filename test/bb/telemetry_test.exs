defmodule BB.TelemetryTest do
  use ExUnit.Case, async: true

  import ExUnit.CaptureLog

  alias BB.Telemetry

  doctest BB.Telemetry

  setup do
    unique = :"event#{System.unique_integer([:positive])}"
    %{event: [:bb, :test, unique], id: unique}
  end

  def forward(event, measurements, metadata, test),
    do: send(test, {event, measurements, metadata})

  def fail(_event, _measurements, _metadata, _config), do: raise("out of order")

  defp attach(id, event) do
    on_exit(fn -> Telemetry.detach(id) end)
    Telemetry.attach(id, event, &__MODULE__.forward/4, self())
  end

  test "a handler is called in the emitting process, with its config", %{event: event, id: id} do
    test = self()

    :ok =
      Telemetry.attach(id, event, fn _, _, _, config -> send(test, {config, self()}) end, :config)

    assert Telemetry.emit(event, %{n: 1}, %{}) == :ok
    assert_received {:config, ^test}
    Telemetry.detach(id)
  end

  test "a handler gets event, measurements and metadata", %{event: event, id: id} do
    assert attach(id, event) == :ok
    Telemetry.emit(event, %{n: 1}, %{of: :a})
    assert_received {^event, %{n: 1}, %{of: :a}}
  end

  test "an event that nobody handles is :ok", %{event: event} do
    assert Telemetry.emit(event, %{}) == :ok
  end

  test "an id is taken once", %{event: event, id: id} do
    assert attach(id, event) == :ok
    assert attach(id, event ++ [:other]) == {:error, :already_exists}
    Telemetry.emit(event ++ [:other], %{})
    refute_received _
  end

  test "a detached handler is not called again", %{event: event, id: id} do
    attach(id, event)
    attach({id, 2}, event)
    assert Telemetry.detach(id) == :ok
    assert Telemetry.detach(id) == {:error, :not_found}
    Telemetry.emit(event, %{})
    assert_received {^event, _, _}
    refute_received _
  end

  test "attach_many is for several events", %{event: event, id: id} do
    other = event ++ [:other]
    :ok = Telemetry.attach_many(id, [event, other], &__MODULE__.forward/4, self())
    for e <- [event, other], do: Telemetry.emit(e, %{})
    assert_received {^event, _, _}
    assert_received {^other, _, _}
    Telemetry.detach(id)
    for e <- [event, other], do: Telemetry.emit(e, %{})
    refute_received _
  end

  test "a failing handler is detached and logged, and the others are called", %{
    event: event,
    id: id
  } do
    :ok = Telemetry.attach(id, event, &__MODULE__.fail/4, nil)
    attach({id, 2}, event)

    log = capture_log(fn -> assert Telemetry.emit(event, %{}) == :ok end)

    assert log =~
             "Telemetry handler #{inspect(id)} failed at #{inspect(event)} and was detached"

    assert log =~ "out of order"

    assert_received {^event, _, _}
    assert Telemetry.detach(id) == {:error, :not_found}
  end

  test "many processes may attach at once", %{event: event, id: id} do
    test = self()

    1..200
    |> Enum.map(
      &Task.async(fn ->
        Telemetry.attach({id, &1}, event, fn _, _, _, _ -> send(test, &1) end, nil)
      end)
    )
    |> Task.await_many(:infinity)

    Telemetry.emit(event, %{})
    for n <- 1..200, do: assert_received(^n)
    for n <- 1..200, do: Telemetry.detach({id, n})
  end

  describe "an event of one of the robot's own parts" do
    test "has its handlers called elsewhere, one after the other, before it returns", context do
      %{event: event, id: id} = context
      test = self()
      handler = fn _, _, _, n -> send(test, {n, self()}) end
      for n <- 1..3, do: :ok = Telemetry.attach({id, n}, event, handler, n)
      on_exit(fn -> for n <- 1..3, do: Telemetry.detach({id, n}) end)
      assert Telemetry.emit(event, %{}, %{}, apart: true) == :ok
      assert_received {1, one}
      assert_received {2, two}
      assert_received {3, three}
      assert length(Enum.uniq([one, two, three, test])) == 4
      assert {:messages, []} = Process.info(self(), :messages)
    end

    test "detaches a handler that hangs or kills its process, and says so once", context do
      %{event: event, id: id} = context

      for {hurt, n} <- Enum.with_index([&hang/0, fn -> Process.exit(self(), :kill) end]) do
        name = {id, n, :failing}
        :ok = Telemetry.attach(name, event, fn _, _, _, _ -> hurt.() end, nil)
        attach({id, n}, event)

        log =
          capture_log(fn ->
            1..10
            |> Enum.map(fn _ ->
              Task.async(fn -> Telemetry.emit(event, %{}, %{}, apart: true) end)
            end)
            |> Task.await_many(60_000)
          end)

        assert [_, _] = String.split(log, "Telemetry handler #{inspect(name)} failed")
        assert_received {^event, _, _}
        assert Telemetry.detach(name) == {:error, :not_found}
      end
    end

    defp hang, do: Process.sleep(:infinity)
  end

  test "events are handed on to :telemetry when that module is loaded", %{event: event} do
    Telemetry.emit(event, %{n: 1}, %{forward_to: self()})
    refute_received {:handed_on, _, _}
    refute Code.ensure_loaded?(:telemetry), "the test stands in for the library"

    Module.create(
      :telemetry,
      quote do
        def execute(event, measurements, %{forward_to: pid}),
          do: send(pid, {:handed_on, event, measurements})

        def execute(_event, _measurements, _metadata), do: :ok
      end,
      Macro.Env.location(__ENV__)
    )

    on_exit(fn ->
      :code.delete(:telemetry)
      :code.purge(:telemetry)
    end)

    assert Telemetry.emit(event, %{n: 2}, %{forward_to: self()}) == :ok
    assert_received {:handed_on, ^event, %{n: 2}}
  end

  test "wrong handlers and events raise", %{event: event, id: id} do
    assert_raise ArgumentError, ~r/expected a function of 4 arguments/, fn ->
      Telemetry.attach(id, event, fn -> 1 end, nil)
    end

    for event <- [:event, [], ["event"]] do
      assert_raise ArgumentError, ~r/a list of atoms, got: /, fn ->
        Telemetry.attach(id, event, &__MODULE__.forward/4, nil)
      end
    end
  end

  describe "span" do
    setup %{event: event, id: id} do
      Telemetry.attach_many(
        id,
        for(e <- [:start, :stop, :exception], do: event ++ [e]),
        &__MODULE__.forward/4,
        self()
      )

      on_exit(fn -> Telemetry.detach(id) end)
      %{start: event ++ [:start], stop: event ++ [:stop], exception: event ++ [:exception]}
    end

    test "tells of beginning and end, and returns the result", %{
      event: event,
      start: start,
      stop: stop
    } do
      assert Telemetry.span(event, %{a: 1}, fn -> {:result, %{b: 2}} end) == :result

      assert_received {^start, %{monotonic_time: begun, system_time: _},
                       %{a: 1, telemetry_span_context: context}}

      assert_received {^stop, %{monotonic_time: ended, duration: duration},
                       %{b: 2, telemetry_span_context: ^context}}

      assert duration == ended - begun
    end

    test "takes further measurements", %{event: event, stop: stop} do
      assert Telemetry.span(event, %{}, fn -> {:result, %{bytes: 3}, %{}} end) == :result
      assert_received {^stop, %{bytes: 3, duration: _}, _}
    end

    test "tells of an exception and lets it pass", %{event: event, exception: exception} do
      assert_raise RuntimeError, "boom", fn ->
        Telemetry.span(event, %{a: 1}, fn -> raise "boom" end)
      end

      assert_received {^exception, %{duration: _},
                       %{a: 1, kind: :error, reason: %RuntimeError{}, stacktrace: [_ | _]}}

      assert catch_throw(Telemetry.span(event, %{}, fn -> throw(:ball) end)) == :ball
      assert_received {^exception, _, %{kind: :throw, reason: :ball}}
    end
  end
end

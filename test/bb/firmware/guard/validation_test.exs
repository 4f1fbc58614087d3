defmodule BB.Firmware.Guard.ValidationTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  alias BB.Firmware.Guard.Validation

  @opts [required: [:imu, :ring], stability_ms: 100, fresh_ms: 20, deadline_ms: 1_000]

  describe "new firmware" do
    test "is validated when all required checks were good for the stability window" do
      {validation, effects} = run([{0, {:status, :unvalidated}} | good(0..100//10)])
      assert effects == [{0, :set_heart}, {0, :init_complete}, {100, :validate}]

      assert {%{phase: :validated}, [:clear_heart]} =
               Validation.handle(validation, {:validation, :ok}, 101)
    end

    test "is not validated a millisecond before" do
      assert {%{phase: :watching}, [_, _]} =
               run([{0, {:status, :unvalidated}} | good(0..90//10)] ++ [{99, :tick}])
    end

    test "is validated by a window that began before the board has told its status" do
      {_, effects} = run(good(0..200//10) ++ [{200, {:status, :unvalidated}}])

      assert Keyword.values(for {at, e} <- effects, do: {:"#{at}", e}) == [
               :set_heart,
               :init_complete,
               :validate
             ]
    end

    test "waits a window more after a required check was bad for a moment" do
      events =
        [{0, {:status, :unvalidated}} | good(0..80//10)] ++
          [{85, {:bad, :imu, :absent}}] ++ good(90..200//10)

      assert {_, [_, _, {190, :validate}]} = run(events)
    end

    test "waits a window more after a gap in what a required check says" do
      events = [{0, {:status, :unvalidated}} | good(0..80//10)] ++ good(101..210//10)
      assert {_, [_, _, {201, :validate}]} = run(events)
    end

    test "is reverted at the deadline, with the reasons" do
      events = [{0, {:status, :unvalidated}}, {990, {:good, :imu}}, {999, {:bad, :ring, :closed}}]
      {validation, effects} = run(events ++ [{1_000, :tick}])
      assert {1_000, :revert} = List.last(effects)

      assert Validation.reasons(validation, 1_000) == [
               imu: {:good_for, 10, 0, nil},
               ring: {:bad, :closed}
             ]
    end

    test "whose sensor never said anything is reverted, and the reason says so" do
      {validation, _} = run([{0, {:status, :unvalidated}}, {1_000, :tick}])
      assert Validation.reasons(validation, 1_000) == [imu: :never, ring: :never]
    end

    test "is not reverted for the sake of a check that is not required" do
      events = [{0, {:status, :unvalidated}}, {0, {:bad, :camera, :absent}} | good(0..100//10)]
      assert {%{phase: :validating}, _} = run(events)
    end

    test "whose validation fails is validated again a second later, while it is stable" do
      opts = Keyword.put(@opts, :deadline_ms, 10_000)
      {validation, _} = run([{0, {:status, :unvalidated}} | good(0..100//10)], opts)
      {validation, []} = Validation.handle(validation, {:validation, {:error, :timeout}}, 105)
      {validation, effects} = run(good(110..1_110//10), validation)
      assert effects == [{1_110, :validate}]
      assert {:validation, {:bad, :timeout}} in Validation.reasons(validation, 1_110)
    end

    test "whose validation never succeeds is reverted at the deadline" do
      {validation, _} = run([{0, {:status, :unvalidated}} | good(0..100//10)])
      assert {%{phase: :reverting}, [:revert]} = Validation.handle(validation, :tick, 1_000)
      {validation, []} = Validation.handle(validation, {:validation, {:error, :io}}, 105)

      assert {%{phase: :reverting} = validation, [:revert]} =
               Validation.handle(validation, :tick, 1_000)

      assert {:validation, {:bad, :io}} in Validation.reasons(validation, 1_000)
    end
  end

  describe "a board" do
    test "whose firmware is validated, or that does not know, is left alone" do
      for status <- [:validated, :unknown] do
        assert {%{phase: :settled, status: ^status}, [{0, :init_complete}]} =
                 run([{0, {:status, status}}, {5, {:bad, :imu, :absent}}, {5_000, :tick}])
      end
    end

    test "that cannot tell at all is left alone at the deadline" do
      events = [{0, {:status, {:error, :timeout}}}, {999, :tick}, {1_000, :tick}, {2_000, :tick}]
      assert {%{phase: :settled, status: :unknown}, [{1_000, :init_complete}]} = run(events)
    end

    test "that tells after some attempts is watched from then on" do
      events = [{0, {:status, {:error, :timeout}}}, {50, {:status, :unvalidated}}]
      assert {%{phase: :watching}, [{50, :set_heart}, {50, :init_complete}]} = run(events)
    end
  end

  property "no schedule validates while a required check is missing or flapping", numtests: 1_000 do
    forall schedule <- schedule() do
      {_, effects} = run(schedule)

      for {at, :validate} <- effects,
          check <- @opts[:required],
          do: assert(steady?(schedule, check, at))

      true
    end
  end

  property "firmware whose required checks are steady is validated when the window is over",
    numtests: 1_000 do
    forall {start, gaps} <- {integer(0, 300), vector(200, integer(1, 20))} do
      times = Enum.scan([start | gaps], &(&1 + &2))
      events = for at <- times, check <- @opts[:required], do: {at, {:good, check}}
      {_, effects} = run([{0, {:status, :unvalidated}} | events])
      assert {Enum.find(times, &(&1 >= start + 100)), :validate} in effects
      true
    end
  end

  property "every schedule ends validated or reverted by the deadline, with one heart callback",
    numtests: 1_000 do
    forall {schedule, answer} <- {schedule(), oneof([:ok, {:error, :io}])} do
      {validation, effects} = run(schedule, @opts, answer)
      effects = Enum.map(effects, &elem(&1, 1))
      count = &Enum.count(effects, fn effect -> effect == &1 end)

      assert validation.phase in [:validated, :reverting]
      assert count.(:set_heart) == 1 and count.(:init_complete) == 1
      assert count.(:clear_heart) + count.(:revert) == 1
      assert count.(:clear_heart) == 1 == (validation.phase == :validated)
      true
    end
  end

  # Gaps are about as long as what counts as fresh.
  defp schedule do
    event =
      frequency([
        {10, {:good, :imu}},
        {10, {:good, :ring}},
        {12, :both},
        {1, {:bad, oneof([:imu, :ring, :camera]), :absent}},
        {2, :tick}
      ])

    map({integer(0, 20), list_of(event)}, fn {asked, steps} ->
      {events, _} =
        Enum.flat_map_reduce(steps, asked, fn {gap, event}, now ->
          now = now + gap
          {Enum.map(expand(event), &{now, &1}), now}
        end)

      events = Enum.filter(events, fn {at, _} -> at < 1_000 end)
      [{asked, {:status, :unvalidated}}] ++ events ++ [{1_000, :tick}]
    end)
  end

  defp list_of(event) do
    bind(integer(0, 150), fn n ->
      bind(oneof([4, 12, 24]), fn gap -> vector(n, {integer(1, gap), event}) end)
    end)
  end

  defp expand(:both), do: [{:good, :imu}, {:good, :ring}]
  defp expand(event), do: [event]

  # The naive twin: looks at each millisecond of the window for itself.
  defp steady?(schedule, check, at),
    do: at >= 100 and Enum.all?((at - 100)..at, &good_at?(schedule, check, &1))

  defp good_at?(schedule, check, ms) do
    said = for {t, event} <- schedule, t <= ms, about?(event, check), do: {t, elem(event, 0)}

    case List.last(said) do
      {t, :good} -> ms - t <= 20
      _ -> false
    end
  end

  defp about?({kind, check}, check) when kind == :good, do: true
  defp about?({:bad, check, _}, check), do: true
  defp about?(_event, _check), do: false

  defp good(range), do: Enum.flat_map(range, &[{&1, {:good, :imu}}, {&1, {:good, :ring}}])

  defp run(events, from \\ @opts, answer \\ nil)
  defp run(events, opts, answer) when is_list(opts), do: run(events, Validation.new(opts), answer)

  defp run(events, validation, answer) do
    Enum.reduce(events, {validation, []}, fn {at, event}, {validation, effects} ->
      {validation, new} = step(validation, event, at, answer)
      {validation, effects ++ new}
    end)
  end

  defp step(validation, event, at, answer) do
    {validation, effects} = Validation.handle(validation, event, at)
    effects = Enum.map(effects, &{at, &1})

    if answer && {at, :validate} in effects do
      {validation, more} = step(validation, {:validation, answer}, at, nil)
      {validation, effects ++ more}
    else
      {validation, effects}
    end
  end
end

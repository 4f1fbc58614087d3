defmodule BB.Firmware.Trial.MarkerTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  alias BB.Firmware.Trial.Marker

  doctest Marker

  @old {"old", "a"}
  @new {"new", "b"}

  defp running(id, status), do: %{id: id, version: "1.0.0", status: status}
  defp accepted, do: %Marker{state: :accepted, boot: "1", from: @old}
  defp written, do: %Marker{accepted() | state: :written}

  defp started(by) do
    %Marker{state: :started, boot: "2", from: @old, firmware: @new, by: by, starts: 1}
  end

  test "an upload that wrote nothing leaves nothing" do
    assert Marker.at_start(accepted(), running(@old, :validated), "2") == {nil, []}
  end

  test "an image that was written and never seen running was reverted" do
    assert {nil, [{:reverted, %Marker{}, by}]} =
             Marker.at_start(written(), running(@old, :validated), "2")

    assert by =~ "before it could say that it had started"
  end

  test "who tries the firmware depends on what the board says of it" do
    for before <- [accepted(), written()],
        {status, by} <- [unvalidated: :board, validated: :guard, unknown: :guard] do
      assert {%Marker{state: :started, by: ^by, firmware: @new, starts: 1}, []} =
               Marker.at_start(before, running(@new, status), "2")
    end
  end

  test "the same image in the other slot is another firmware" do
    assert {%Marker{state: :started}, []} =
             Marker.at_start(written(), running({"old", "b"}, :unvalidated), "2")
  end

  test "an update that came by another way is on trial where the board says so" do
    assert {%Marker{by: :board, from: nil}, []} =
             Marker.at_start(nil, running(@new, :unvalidated), "1")

    for status <- [:validated, :unknown],
        do: assert(Marker.at_start(nil, running(@new, status), "1") == {nil, []})
  end

  test "firmware that was on trial and does not run any more was reverted" do
    for by <- [:board, :guard] do
      assert {nil, [{:reverted, %Marker{firmware: @new}, words}]} =
               Marker.at_start(started(by), running(@old, :validated), "3")

      assert words =~ "power cut"
    end

    decided = %Marker{started(:board) | verdict: "its guard"}

    assert {nil, [{:reverted, ^decided, "its guard"}]} =
             Marker.at_start(decided, running(@old, :validated), "3")
  end

  test "firmware that the board has validated is on trial no more" do
    assert Marker.at_start(started(:board), running(@new, :validated), "3") == {nil, []}
  end

  test "firmware that only the guard tries is reverted after some starts, and not for ever" do
    {marker, actions} =
      Enum.reduce(3..20, {started(:guard), []}, fn boot, {marker, actions} ->
        {marker, more} = Marker.at_start(marker, running(@new, :unknown), "#{boot}")
        {marker, actions ++ more}
      end)

    assert marker == nil
    assert [{:revert, first} | _] = actions
    assert first.starts == 4 and first.verdict =~ "3 starts in vain"
    assert Enum.count(actions, &match?({:revert, _}, &1)) == 3
    assert {:give_up, _} = List.last(actions)
  end

  test "a revert that did not lead anywhere is tried again at the next start" do
    decided = %Marker{started(:guard) | verdict: "its guard"}

    assert {%Marker{starts: 2}, [{:revert, _}]} =
             Marker.at_start(decided, running(@new, :unknown), "3")
  end

  property "looking twice in one start changes nothing the second time", numtests: 300 do
    forall {marker, {id, status}} <- {oneof([exactly(nil), marker()]), runs()} do
      {first, _} = Marker.at_start(marker, running(id, status), "now")
      {second, actions} = Marker.at_start(first, running(id, status), "now")
      assert {second, actions} == {first, []}
      true
    end
  end

  property "a marker is read as it was written, and no damaged text raises", numtests: 500 do
    forall {marker, at, byte} <- {marker(), integer(0, 500), integer(0, 255)} do
      text = Marker.encode(marker)
      assert Marker.decode(text) == {:ok, marker}
      at = rem(at, byte_size(text))
      head = binary_part(text, 0, at)
      tail = binary_part(text, at + 1, byte_size(text) - at - 1)
      for damaged <- [head, head <> <<byte>> <> tail], do: decode(damaged)
      true
    end
  end

  # What is read from a file is valid text.
  defp decode(text) do
    if String.valid?(text), do: assert(match?({:ok, _}, Marker.decode(text)) or :error)
  end

  defp runs do
    {oneof([@old, @new, {"new", nil}]), oneof([:validated, :unvalidated, :unknown])}
  end

  defp marker do
    map({integer(0, 3), integer(0, 7), oneof([:board, :guard])}, fn {state, starts, by} ->
      case state do
        0 -> accepted()
        1 -> written()
        2 -> %Marker{started(by) | starts: starts, notes: ["one thing", "another"]}
        3 -> %Marker{started(by) | starts: starts, verdict: "its guard", firmware: {"new", nil}}
      end
    end)
  end
end

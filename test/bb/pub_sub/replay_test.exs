defmodule BB.PubSub.ReplayTest do
  use ExUnit.Case, async: true

  alias BB.PubSub.{Admission, Replay, Subscription, SubscriptionState}

  describe "a message that is being replayed" do
    setup do
      sequence = :atomics.new(1, [])
      :atomics.put(sequence, 1, 9)
      subscription = Subscription.new([:a], replay: true)
      cell = SubscriptionState.new_cell()
      admission = Admission.new(subscription, cell)

      stamped = fn n ->
        Admission.deliver([admission], self_of(subscription), {:bb, n}, {n, sequence})
      end

      %{cell: cell, subscription: subscription, publish: stamped}
    end

    defp self_of(%{pid: pid}), do: pid

    # Every order of a publisher's message and the replay of message 5: before, between the two
    # steps, and after. The messages arrive in order, once each, and end with the newest.
    test "stands before everything newer, once, whenever publishers come", context do
      %{cell: cell, publish: publish} = context

      for early <- [[], [4], [5], [6], [4, 6], [6, 7], [6, 4]], late <- [[], [4], [5], [8]] do
        for index <- 1..2, do: :atomics.put(cell, index, 0)
        # The subscriber has announced the replay of 5, and others publish.
        :atomics.put(cell, 1, -5)
        Enum.each(early, publish)
        if :atomics.compare_exchange(cell, 1, -5, 5) == :ok, do: send(self(), {:bb, 5})
        Enum.each(late, publish)

        newer = Enum.filter(early ++ late, &(&1 > 5))
        overtaken? = Enum.any?(early, &(&1 > 5))
        assert arrived([]) == if(overtaken?, do: newer, else: [5 | newer])
      end
    end

    test "is sent by the subscriber alone when nobody comes", %{cell: cell, publish: publish} do
      :ok = Replay.run(cell, 5, fn -> send(self(), {:bb, 5}) end, fn -> flunk("taken back") end)
      Enum.each([4, 5, 6], publish)
      assert arrived([]) == [5, 6]
    end

    test "is left out when a publisher was first", %{cell: cell, publish: publish} do
      publish.(9)
      :ok = Replay.run(cell, 5, fn -> flunk("replayed") end, fn -> flunk("taken back") end)
      assert arrived([]) == [9]
    end

    test "is not passed by an older one of a publisher that is late", context do
      %{cell: cell, publish: publish} = context
      publish.(8)
      :ok = Replay.run(cell, 9, fn -> send(self(), {:bb, 9}) end, fn -> flunk("taken back") end)
      assert arrived([]) == [9]
    end

    test "is taken back when a publisher could not wait until it was sent", context do
      %{cell: cell, publish: publish} = context

      send_late = fn ->
        # The thread of the subscriber is suspended here, for longer than a publisher waits.
        Task.await(Task.async(fn -> publish.(6) end), 60_000)
        send(self(), {:bb, 5})
      end

      take_back = fn -> receive do: ({:bb, 5} -> :ok) end
      :ok = Replay.run(cell, 5, send_late, take_back)
      publish.(7)
      assert arrived([]) == [6, 7]
    end

    test "is waited for by nobody when the replays are over", context do
      %{subscription: subscription, publish: publish} = context
      Replay.finish(subscription.counters)
      Enum.each([1, 2], publish)
      assert arrived([]) == [1, 2]
    end

    defp arrived(numbers) do
      receive do
        {:bb, n} -> arrived([n | numbers])
      after
        0 -> Enum.reverse(numbers)
      end
    end
  end
end

defmodule BB.Firmware.Gate.LockTest do
  use ExUnit.Case, async: true
  use BB.Test.Prop

  alias BB.Firmware.Gate.Lock

  doctest Lock

  @settle_ms 50

  property "one uploader at a time, none within the settling time of another, none after one that succeeded",
    numtests: 1_000 do
    forall events <- list(event()) do
      Enum.reduce(events, {0, :free, nil, nil, false}, &step/2)
      true
    end
  end

  # Who is in, and when the last one left, are kept beside the lock and without it.
  defp step({gap, event}, {now, lock, inside, left_at, written?}) do
    now = now + gap

    case event do
      {:enter, n} ->
        may? = inside == nil and not written? and (left_at == nil or now - left_at >= @settle_ms)

        case Lock.enter(lock, pid(n), now) do
          {:ok, lock} ->
            assert may? and {now, lock, n, nil, written?}

          {:error, reason} ->
            assert not may? and reason == :written == written? and
                     {now, lock, inside, left_at, written?}
        end

      {:left, n} ->
        lock = Lock.handle_down(lock, pid(n), now, @settle_ms)

        if n == inside,
          do: {now, lock, nil, now, written?},
          else: {now, lock, inside, left_at, written?}

      :passed ->
        {now, Lock.handle_timeout(lock, now), inside, left_at, written?}

      :written ->
        {now, Lock.written(lock), inside, left_at, true}
    end
  end

  defp event do
    who = integer(1, 3)

    {integer(0, 40),
     frequency([
       {6, {:enter, who}},
       {6, {:left, who}},
       {3, :passed},
       {1, oneof([:written, :passed, :passed])}
     ])}
  end

  defp pid(n), do: :erlang.list_to_pid(~c"<0.#{n}.0>")
end

defmodule BB.Test.ChaosNode do
  @moduledoc """
  A BEAM node that `bin/chaos ring` kills. It publishes and reads topics through `BB.Ring`, and
  records the accepted messages.

  Messages and records are those of the crate `chaos` (`message.rs`, `record.rs`). The environment
  configures it:

    * `CHAOS_PUBLISH`, `CHAOS_SUBSCRIBE`: topics, each
      `number:name:slot_count:slot_size:burst:pause_ms`, separated by spaces
    * `CHAOS_LOG`: the file for the record of each accepted message
    * `CHAOS_SEED`: the seed of the random choices

  It ends with its standard input, and with status 1 after any failure.
  """

  import Bitwise

  alias BB.Ring.{Message, Publisher, Subscriber}

  @header 36
  @instance_at 32
  @credits 64
  @mask 0xFFFF_FFFF_FFFF_FFFF

  @doc "Starts the node; returns at once."
  def main do
    spawn(fn ->
      Process.flag(:trap_exit, true)
      seed = String.to_integer(System.fetch_env!("CHAOS_SEED"))

      for {topic, n} <- Enum.with_index(topics("CHAOS_PUBLISH")),
          do: spawn_link(fn -> publish(topic, seed + n) end)

      for topic <- topics("CHAOS_SUBSCRIBE"), do: spawn_link(fn -> subscribe(topic) end)
      spawn_link(fn -> await_end_of_input() end)

      receive do
        {:EXIT, _pid, reason} ->
          IO.puts(:stderr, "chaos node: #{inspect(reason)}")
          System.halt(1)
      end
    end)
  end

  defp topics(variable) do
    for text <- String.split(System.fetch_env!(variable)) do
      [number, name | rest] = String.split(text, ":")
      [count, size, burst, pause] = Enum.map(rest, &String.to_integer/1)

      %{
        number: String.to_integer(number),
        name: name,
        slot_count: count,
        slot_size: size,
        burst: burst,
        pause: pause
      }
    end
  end

  defp await_end_of_input do
    case IO.read(:stdio, :line) do
      :eof -> System.halt(0)
      _line -> await_end_of_input()
    end
  end

  defp publish(topic, seed) do
    :rand.seed(:exsss, seed)
    slots = [slot_count: topic.slot_count, slot_size: topic.slot_size]
    {:ok, publisher} = Publisher.open(topic.name, slots)
    {:ok, %{published: next}} = Publisher.info(publisher)

    publish(publisher, topic, %{
      writer: :rand.uniform(@mask),
      instance: instance(topic.name),
      sequence: next
    })
  end

  defp publish(publisher, topic, identity) do
    identity =
      Enum.reduce(1..:rand.uniform(topic.burst), identity, fn _, identity ->
        :ok =
          Publisher.publish(
            publisher,
            message(topic.number, identity, length_of(topic.slot_size))
          )

        Map.update!(identity, :sequence, &(&1 + 1))
      end)

    receive do
    after
      :rand.uniform(topic.pause) -> publish(publisher, topic, identity)
    end
  end

  # Small messages are as likely as large ones; every other long message has the maximum length.
  defp length_of(slot_size) do
    span = slot_size - 20 - @header + 1
    bits = round(:math.log2(span))

    if span > 100_000 and :rand.uniform(2) == 1,
      do: slot_size - 20,
      else: @header + :rand.uniform(min(span, 1 <<< :rand.uniform(bits + 1))) - 1
  end

  defp message(number, %{writer: writer, instance: instance, sequence: sequence}, size) do
    head =
      <<number::little-32, size::little-32, writer::little-64, instance::little-64,
        sequence::little-64>>

    word = bxor(writer, sequence * 0x9E37_79B9_7F4A_7C15 &&& @mask)
    length = size - @header

    words = :binary.copy(<<word::little-64>>, div(length, 8) + 1)
    body = binary_part(words, 0, length)

    [head, <<:erlang.crc32([head, body])::little-32>>, body]
  end

  # The topic keeps its name as long as its publisher is open.
  defp instance(name) do
    {:ok, file} = :file.open("/dev/shm/conduit_#{name}", [:read, :raw, :binary])
    {:ok, <<instance::little-64>>} = :file.pread(file, @instance_at, 8)
    :ok = :file.close(file)
    instance
  end

  defp subscribe(topic) do
    {:ok, log} = :file.open(System.fetch_env!("CHAOS_LOG"), [:append, :raw, :binary])
    {:ok, %{ref: ref} = subscriber} = Subscriber.open(topic.name, active: @credits)
    accept(subscriber, ref, topic.number, log)
  end

  defp accept(subscriber, ref, number, log) do
    receive do
      {:bb_ring, ^ref, %Message{} = message} -> :ok = :file.write(log, record(number, message))
      {:bb_ring_passive, ^ref} -> :ok = Subscriber.active(subscriber, @credits)
      {:bb_ring, ^ref, event} when event in [:publisher_up, :publisher_down] -> :ok
      {:bb_ring, ^ref, {:error, reason}} -> exit({number, reason})
    end

    accept(subscriber, ref, number, log)
  end

  defp record(number, %Message{sequence: sequence, timestamp_ns: time, lost: lost} = message) do
    {verdict, instance, writer, checksum} =
      case verify(message.data, number, sequence) do
        {:ok, proof} -> proof
        :error -> {1, 0, 0, 0}
      end

    <<verdict::little-32, number::little-32, sequence::little-64, instance::little-64,
      writer::little-64, checksum::little-32, lost::little-32, time::little-64, 0::128>>
  end

  defp verify(data, number, sequence) do
    with <<head::binary-size(32), sum::little-32, body::binary>> <- data,
         <<^number::little-32, size::little-32, writer::little-64, instance::little-64,
           ^sequence::little-64>> <- head,
         true <- size == byte_size(data) and sum == :erlang.crc32([head, body]) do
      {:ok, {0, instance, writer, sum}}
    else
      _ -> :error
    end
  end
end

# Publish and subscribe through the ring, the shared memory between the BEAM and native processes.
#
#     mix run examples/ring.exs
#
# Here publisher and subscriber are in the BEAM. Either may be a program in another language: a
# topic is a file in /dev/shm.

alias BB.Ring
alias BB.Ring.{Message, Publisher, Subscriber}

# A name that no other process on this machine uses.
topic = "example_#{System.pid()}"

# Eight slots for messages of up to 100 bytes.
{:ok, publisher} = Publisher.open(topic, depth: 8, max_message_size: 100)

# An active subscriber receives messages in its mailbox. `active: 3` gives credit for three of
# them, so that a fast publisher cannot fill the mailbox; further messages wait in the ring.
{:ok, subscriber} = Subscriber.open(topic, active: 3, start: {:history, 8})
%Subscriber{ref: ref} = subscriber

for n <- 0..2, do: :ok = Publisher.publish(publisher, ["scan ", to_string(n)])

for _ <- 0..2 do
  receive do
    {:bb_ring, ^ref, %Message{} = message} ->
      age_us = div(Ring.now_ns() - message.timestamp_ns, 1000)
      IO.puts("message #{message.sequence}: #{message.data}, #{age_us} µs old")
  end
end

receive do
  {:bb_ring_passive, ^ref} -> IO.puts("the credit is used up")
end

# The publisher never waits. It overwrites the oldest messages.
for n <- 3..22, do: :ok = Publisher.publish(publisher, "scan #{n}")

# A passive subscriber calls recv/2. It gets the oldest message that remains, with the number of
# lost ones.
{:ok, %Message{} = message} = Subscriber.recv(subscriber, 1000)
IO.puts("message #{message.sequence}: #{message.data}, after #{message.lost} lost")

# latest/1 returns the newest message, for example of a camera.
{:ok, %Message{} = newest} = Subscriber.latest(subscriber)
IO.puts("message #{newest.sequence}: #{newest.data}")

# Failures are values. A topic has one publisher at a time.
{:error, reason} = Publisher.open(topic)
{:publisher_alive, _os_pid} = reason
IO.puts("no second publisher: #{Ring.format_error(reason)}")

{:ok, info} = Ring.info(topic)
IO.puts("published: #{info.published}, subscribers: #{length(info.readers)}")

:ok = Subscriber.close(subscriber)
:ok = Publisher.close(publisher)
{:error, {:no_topic, _path}} = Ring.info(topic)

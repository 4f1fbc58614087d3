# A native process as a sensor: it starts, restarts and stops with the robot, and publishes on the
# ring.
#
#     mix run examples/native_process.exs
#
# The process is the camera that ships. It publishes frames of a rendered scene: a header of 44
# bytes, then pixels.

defmodule Watcher do
  @moduledoc "A robot with a camera."

  use BB

  # A name that no other process on this machine uses.
  @topic "example_frames_#{System.pid()}"

  sensors do
    sensor :camera,
           {BB.Sensor.NativeProcess,
            program: "camera", topics: [topic: @topic], args: ["--rate", "100"]}
  end

  def topic, do: @topic
end

defmodule Frames do
  @moduledoc "Reads the camera's frames from the ring."

  alias BB.Ring.{Message, Subscriber}

  def next(subscriber) do
    {:ok, %Message{sequence: sequence, data: data}} = Subscriber.recv(subscriber, 10_000)

    <<"CM", 1, _flags, width::little-32, height::little-32, "GREY", _stride::little-32,
      size::little-32, _rest_of_header::binary-size(20), _pixels::binary-size(size)>> = data

    {sequence, "#{width} × #{height}"}
  end

  # Reads frames until the first one of a new camera, whose process is not `dead`.
  def after_restart(subscriber, dead) do
    {sequence, _size} = next(subscriber)
    {:ok, %{writer_pid: alive}} = BB.Ring.info(Watcher.topic())
    if alive == dead, do: after_restart(subscriber, dead), else: sequence
  end
end

# A subscriber may open a topic that does not exist yet.
{:ok, subscriber} = BB.Ring.Subscriber.open(Watcher.topic(), policy: :latest)
{:ok, _} = Watcher.start_link()
{:ok, _} = BB.subscribe(Watcher, [:sensor_status, :camera])

{first, size} = Frames.next(subscriber)
IO.puts("frames of #{size}")

# Kill it, as the kernel does when memory is short. Its sensor goes down with a reason, the next
# camera takes over the topic in place, and the subscriber continues after a gap in time.
{:ok, %{writer_pid: os_pid}} = BB.Ring.info(Watcher.topic())
{_, 0} = System.cmd("kill", ["-9", to_string(os_pid)])

receive do
  {:bb, _path, %{payload: %BB.Message.Sensor.Status{state: :backoff, reason: reason}}} ->
    IO.puts("camera is down: #{inspect(reason)}")
end

next = Frames.after_restart(subscriber, os_pid)
true = next > first
IO.puts("frames again, with the next numbers")

# When the robot stops, its processes end, and the topic with them. The script is linked to the
# robot, and traps its exit.
Process.flag(:trap_exit, true)
:ok = Supervisor.stop(Watcher)
{:error, {:no_topic, _path}} = BB.Ring.info(Watcher.topic())
IO.puts("the topic is gone")

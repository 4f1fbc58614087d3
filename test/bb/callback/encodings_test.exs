defmodule BB.Callback.EncodingsTest do
  @moduledoc """
  Each callback of an encoding fails in every way, without an effect beyond its outlet or inlet.
  """
  use ExUnit.Case, async: true

  import BB.Test.Eventually
  import BB.Test.Neighbourhood
  import BB.Test.Robot, only: [health: 2]

  alias BB.Test.Counter.Count
  alias BB.Test.{Mischief, Run}

  describe "an encoding" do
    for callback <- Mischief.encoding_callbacks(), kind <- Mischief.kinds() do
      topic = Run.unique("encoding")
      module = Mischief.encoding(callback, kind)
      robot = declared(handoff(callback, topic, module))
      @tag callback: callback, kind: kind, topic: topic, culprit: module, robot: robot
      test "whose #{callback} does wrong does not hurt others: #{kind}", context do
        %{callback: callback, topic: topic, culprit: module, robot: robot} = context
        on_exit(fn -> File.rm("/dev/shm/conduit_" <> topic) end)
        feed(callback, topic)
        root = start(robot)
        neighbour = BB.Process.whereis(robot, :neighbour)
        happens!(module)
        if context.kind == :huge, do: opens!(robot)
        goes_on!(robot, neighbour)
        console_shows!(robot)
        goes_on!(robot, neighbour)
        stops!(robot, root)
      end
    end
  end

  test "an encoding that does not return holds up no more than some messages" do
    module = Mischief.encoding(:encode, :hang)
    topic = Run.unique("encoding")
    on_exit(fn -> File.rm("/dev/shm/conduit_" <> topic) end)
    robot = declared(handoff(:encode, topic, module))
    root = start(robot)
    happens!(module)
    message = Count.new(:many, n: 1) |> elem(1)
    for _ <- 1..20_000, do: BB.publish(robot, [:sensor, :base, :neighbour], message)
    outlet = BB.Process.whereis(robot, :bad)
    assert {:message_queue_len, waiting} = Process.info(outlet, :message_queue_len)
    assert waiting in 1_000..6_000
    stops!(robot, root)
  end

  # A process killed while it opens its topic would leave the topic behind.
  defp opens!(robot), do: eventually(fn -> health(robot, :bad).state != :starting end, long_ms())

  # Publishes bytes for an inlet to decode.
  defp feed(:decode, topic) do
    start_supervised!(
      {Task,
       fn ->
         {:ok, ring} = BB.Ring.Publisher.open(topic, content: "mischief")
         publish_for_ever(ring)
       end}
    )
  end

  defp feed(_callback, _topic), do: :ok

  defp publish_for_ever(ring) do
    :ok = BB.Ring.Publisher.publish(ring, "count")
    Process.sleep(2)
    publish_for_ever(ring)
  end
end

defmodule BB.Test.Numbered do
  @moduledoc """
  Numbered messages for tests of the bus: publishes them, and lists the numbers that an actor got.

      publish(robot, [:a], 1..3)
      numbers(actor)
      #=> [{[:a], 1}, {[:a], 2}, {[:a], 3}]
  """

  import BB.Test.Eventually

  alias BB.{Message, PubSub}
  alias BB.Message.Sensor.{PowerState, Status}
  alias BB.Test.Actor

  @doc "Returns the name of a robot that no other test has."
  def new_robot(test), do: Module.concat(test, "Robot#{System.unique_integer([:positive])}")

  @doc "Starts the pubsub of a robot of the test's own, and an actor, for `setup`."
  def start_pub_sub(%{module: test}) do
    robot = new_robot(test)
    ExUnit.Callbacks.start_supervised!({PubSub, robot})
    %{robot: robot, actor: Actor.start()}
  end

  @doc "Creates a message with a number."
  def status(n), do: Message.new!(Status, :frame, state: :up, restarts: n)

  @doc "Creates a message of another type."
  def power, do: Message.new!(PowerState, :frame, voltage: 1.0, current: 0.0)

  @doc "Publishes messages with these numbers."
  def publish(robot, path, ns), do: Enum.each(ns, &PubSub.publish(robot, path, status(&1)))

  @doc "Subscribes an actor."
  def subscribe(actor, robot, path, opts \\ []),
    do: {:ok, _} = Actor.run(actor, fn -> PubSub.subscribe(robot, path, opts) end)

  @doc "Returns `{path, number}` of each message that an actor got since the last call."
  def numbers(actor) do
    for {path, %Status{restarts: n}} <- Actor.received(actor), do: {path, n}
  end

  @doc "Waits for the route of a stream, so that tests cover publishers with and without one."
  def await_route(robot, path, type \\ Status) do
    eventually(fn ->
      {_, routes, _} = :persistent_term.get(robot)
      PubSub.Routes.find(routes, path, type)
    end)
  end
end

defmodule BB.Handoff do
  @moduledoc """
  Where the pubsub and the ring meet.

  An **outlet** (`BB.Handoff.Outlet`) carries a pubsub path into a ring topic, an **inlet** (`BB.Handoff.Inlet`) a ring topic onto a pubsub path.
  Both are declared in the robot like sensors, and supervised like them: what fails goes down alone and comes back. Payloads are
  translated by encodings (`BB.Handoff.Encoding`).

      sensors do
        sensor :imu_outlet, {BB.Handoff.Outlet, from: [:sensor, :base_link, :imu], topic: "imu", encoding: BB.Handoff.Encoding.Imu}
        sensor :tags_inlet, {BB.Handoff.Inlet, topic: "tags", encoding: BB.Handoff.Encoding.TagDetections}
      end
  """

  @doc """
  What an outlet or inlet has carried since it started, by its name in the robot: counters as its module documents them.

  `{:error, :not_running}` while it is down.
  """
  @spec stats(module(), atom()) :: {:ok, %{atom() => non_neg_integer()}} | {:error, :not_running}
  def stats(robot, name) do
    {:ok, BB.call(robot, name, :stats)}
  catch
    :exit, _reason -> {:error, :not_running}
  end
end

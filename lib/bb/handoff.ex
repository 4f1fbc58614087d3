defmodule BB.Handoff do
  @moduledoc """
  Messages between the pubsub and the ring, and so between the BEAM and native programs.

  Declare an **outlet** (`BB.Handoff.Outlet`) to carry a pubsub path into a ring topic, and an
  **inlet** (`BB.Handoff.Inlet`) to carry a ring topic onto a pubsub path:

      sensors do
        sensor :imu_outlet,
               {BB.Handoff.Outlet,
                from: [:sensor, :base_link, :imu],
                topic: "imu",
                encoding: BB.Handoff.Encoding.Imu}

        sensor :tags_inlet,
               {BB.Handoff.Inlet, topic: "tags", encoding: BB.Handoff.Encoding.TagDetections}
      end

  Both are supervised like sensors: one that fails goes down alone and is restarted. Encodings
  (`BB.Handoff.Encoding`) translate the payloads.
  """

  @doc """
  Returns the counters of an outlet or inlet since it started.

  `name` is its name in the robot; its module documents the counters. Returns
  `{:error, :not_running}` while it is down.
  """
  @spec stats(module(), atom()) :: {:ok, %{atom() => non_neg_integer()}} | {:error, :not_running}
  def stats(robot, name) do
    {:ok, BB.call(robot, name, :stats)}
  catch
    :exit, _reason -> {:error, :not_running}
  end
end

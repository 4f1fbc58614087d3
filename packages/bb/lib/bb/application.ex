defmodule BB.Application do
  @moduledoc """
  The application `:bb`. Its supervisor has no children: the processes that all robots share are
  those of the application `:ganglion`, which starts before it.

  OTP starts it for a project that depends on `:bb`:

      {:ok, _started} = Application.ensure_all_started(:bb)
      {:ok, _root} = MyRobot.start_link()
  """

  use Application

  @impl Application
  def start(_type, _args), do: Supervisor.start_link([], strategy: :one_for_one, name: __MODULE__)
end

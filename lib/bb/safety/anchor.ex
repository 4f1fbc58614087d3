defmodule BB.Safety.Anchor do
  @moduledoc """
  Holds `BB.Safety.Supervisor` up: starts it again when it was killed. It stands in the
  application's tree, first of all; safety itself stands outside.
  """

  use GenServer
  use BB.Process.Tolerant

  alias BB.Safety.Supervisor

  @doc false
  @spec start_link(keyword()) :: GenServer.on_start()
  def start_link(_opts), do: GenServer.start_link(__MODULE__, nil, name: __MODULE__)

  @impl GenServer
  def init(nil) do
    # So that nobody is unwatched for longer than it must be.
    Process.flag(:priority, :high)
    {:ok, hold()}
  end

  @impl GenServer
  def handle_info({:DOWN, ref, :process, _pid, _reason}, ref), do: {:noreply, hold()}

  defp hold do
    Supervisor.start()
    Process.monitor(Supervisor)
  end
end

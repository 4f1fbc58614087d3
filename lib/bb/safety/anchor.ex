defmodule BB.Safety.Anchor do
  @moduledoc """
  Starts `BB.Safety.Supervisor` again when it was killed. It is the first child of the
  application's supervisor; the processes of safety stand outside of the application.
  """
  @moduledoc no_example: "internal: the application starts it"

  use GenServer
  use BB.Process.Tolerant

  alias BB.Safety.Supervisor

  @doc false
  @spec start_link(keyword()) :: GenServer.on_start()
  def start_link(_opts), do: GenServer.start_link(__MODULE__, nil, name: __MODULE__)

  @impl GenServer
  def init(nil) do
    # Robots are without a warden until the supervisor runs again.
    Process.flag(:priority, :high)
    {:ok, start_and_monitor()}
  end

  @impl GenServer
  def handle_info({:DOWN, ref, :process, _pid, _reason}, ref), do: {:noreply, start_and_monitor()}

  defp start_and_monitor do
    Supervisor.start()
    Process.monitor(Supervisor)
  end
end

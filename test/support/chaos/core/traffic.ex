defmodule BB.Test.Chaos.Core.Traffic do
  @moduledoc "Records the messages of a robot's sensors across restarts of the robot."

  use GenServer

  @again_ms 20

  @doc "Starts to record."
  def start_link(robot), do: GenServer.start_link(__MODULE__, robot)

  @doc "Returns the number of messages of each path."
  @spec report(pid()) :: %{[atom()] => pos_integer()}
  def report(pid), do: GenServer.call(pid, :report, :infinity)

  @impl GenServer
  def init(robot), do: {:ok, subscribe(%{robot: robot, root: nil, counts: %{}})}

  @impl GenServer
  def handle_call(:report, _from, state), do: {:reply, state.counts, state}

  @impl GenServer
  def handle_info({:bb, path, _message}, state),
    do: {:noreply, %{state | counts: Map.update(state.counts, path, 1, &(&1 + 1))}}

  # A bus lives as long as its robot's root.
  def handle_info({:DOWN, root, :process, _pid, _reason}, %{root: root} = state),
    do: {:noreply, subscribe(%{state | root: nil})}

  def handle_info(:subscribe, state), do: {:noreply, subscribe(state)}

  defp subscribe(state) do
    with pid when is_pid(pid) <- Process.whereis(state.robot),
         {:ok, _} <- BB.subscribe(state.robot, [:sensor]) do
      %{state | root: Process.monitor(pid)}
    else
      _not_started -> later(state)
    end
  rescue
    _not_started -> later(state)
  catch
    :exit, _gone -> later(state)
  end

  defp later(state) do
    Process.send_after(self(), :subscribe, @again_ms)
    state
  end
end

defmodule BB.Test.Network do
  @moduledoc "A network whose state a test sets. The adapter is `{BB.Test.Network, pid}`."

  use Agent

  @behaviour BB.Firmware.Network.Adapter

  def start_link(state), do: Agent.start_link(fn -> {state, []} end)

  @doc "Changes the state, and notifies the subscribers."
  def set(network, state) do
    Agent.update(network, fn {_, subscribers} ->
      Enum.each(subscribers, &send(&1, {__MODULE__, network, state}))
      {state, subscribers}
    end)
  end

  @impl BB.Firmware.Network.Adapter
  def subscribe(network) do
    me = self()
    Agent.update(network, fn {state, subscribers} -> {state, [me | subscribers]} end)
  end

  @impl BB.Firmware.Network.Adapter
  def state(network), do: Agent.get(network, &elem(&1, 0))

  @impl BB.Firmware.Network.Adapter
  def change(network, {__MODULE__, network, state}), do: {:ok, state}
  def change(_network, _message), do: :error

  # Notifies the process that has started the network, as the board in memory does.
  @impl BB.Firmware.Network.Adapter
  def name(network, name), do: tell(network, {:name, name})

  @impl BB.Firmware.Network.Adapter
  def join(network, wifi), do: tell(network, {:join, wifi})

  defp tell(network, what) do
    {:links, [starter | _]} = Process.info(network, :links)
    _ = send(starter, {__MODULE__, what})
    :ok
  end
end

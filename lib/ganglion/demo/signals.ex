defmodule Ganglion.Demo.Signals do
  @moduledoc """
  Tells a process of SIGTERM (`{:signal, :sigterm}`), in place of the VM's own handler, which would stop the VM at once.
  """

  @behaviour :gen_event

  @doc "Signals go to `pid` from now on."
  @spec forward_to(pid()) :: :ok
  def forward_to(pid) do
    :gen_event.swap_handler(:erl_signal_server, {:erl_signal_handler, []}, {__MODULE__, pid})
  end

  @impl :gen_event
  def init({pid, _from_the_handler_before}), do: {:ok, pid}

  @impl :gen_event
  def handle_event(signal, pid) do
    send(pid, {:signal, signal})
    {:ok, pid}
  end

  @impl :gen_event
  def handle_call(_request, pid), do: {:ok, :ok, pid}
end

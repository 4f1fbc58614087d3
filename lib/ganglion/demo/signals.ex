defmodule Ganglion.Demo.Signals do
  @moduledoc """
  A handler of operating-system signals that sends them to a process, such as
  `{:signal, :sigterm}`.

  The demonstration uses it to stop its robot in order. It replaces the VM's own handler, which
  would stop the VM at once.

      :ok = Ganglion.Demo.Signals.forward_to(self())
  """

  @behaviour :gen_event

  @doc "Replaces the VM's handler, so that signals go to `pid`."
  @spec forward_to(pid()) :: :ok
  def forward_to(pid) do
    :gen_event.swap_handler(:erl_signal_server, {:erl_signal_handler, []}, {__MODULE__, pid})
  end

  @impl :gen_event
  def init({pid, _replaced_handler}), do: {:ok, pid}

  @impl :gen_event
  def handle_event(signal, pid) do
    send(pid, {:signal, signal})
    {:ok, pid}
  end

  @impl :gen_event
  def handle_call(_request, pid), do: {:ok, :ok, pid}
end

defmodule BB.Test.Shoehorn do
  @moduledoc """
  Simulates shoehorn on the host.

  As in shoehorn, a filter of the logger receives the starts and ends of applications, and a
  process calls the handler.

      handler = BB.Test.Shoehorn.start(BB.Firmware.Applications, state, [:my_app])
  """

  use GenServer

  @doc "Reports these applications to `module`, with a handler's state, until its caller ends."
  def start(module, state, apps) do
    {:ok, pid} = GenServer.start_link(__MODULE__, {module, state, apps})
    pid
  end

  @impl GenServer
  def init({module, state, apps}) do
    Process.flag(:trap_exit, true)
    :ok = :logger.add_primary_filter(id(), {&__MODULE__.filter/2, self()})
    {:ok, {module, state, apps}}
  end

  @impl GenServer
  def handle_cast({:exit, app, reason}, {module, state, apps}) do
    if app in apps, do: {:continue, _state} = module.application_exited(app, reason, state)
    {:noreply, {module, state, apps}}
  end

  def handle_cast({:started, app}, {module, state, apps}) do
    if app in apps, do: {:continue, _state} = module.application_started(app, state)
    {:noreply, {module, state, apps}}
  end

  @impl GenServer
  def terminate(_reason, _state), do: :logger.remove_primary_filter(id())

  @doc false
  def filter(%{msg: {:report, %{label: {:application_controller, kind}, report: report}}}, pid) do
    case {kind, report} do
      {:progress, [application: app, started_at: _]} -> GenServer.cast(pid, {:started, app})
      {:exit, [application: app, exited: why, type: _]} -> GenServer.cast(pid, {:exit, app, why})
      _other -> :ok
    end

    :ignore
  end

  def filter(_event, _pid), do: :ignore

  defp id, do: :"shoehorn_#{inspect(self())}"
end

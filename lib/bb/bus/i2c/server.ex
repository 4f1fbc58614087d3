defmodule BB.Bus.I2C.Server do
  @moduledoc """
  The process of one bus.

  `BB.Bus.I2C.Client` starts and calls it. It makes the transfers itself, so the order of its
  mailbox is the order of the transfers. `BB.Bus.I2C.Recovery` decides when it closes and reopens
  the backend.

  Its row of `BB.Bus.I2C.health/0` is the value of its entry in the registry, so readers call no
  process.

  It ends without handles. While the bus has trouble it waits five seconds first, so that sensors
  which restart one after the other still count as sensors of one bus.
  """
  @moduledoc no_example: "internal: BB.Bus.I2C is its interface"

  use GenServer, restart: :temporary
  use BB.Process.Tolerant

  alias BB.Bus.I2C.Recovery
  alias BB.Bus.I2C.Supervisor, as: Buses

  require Logger

  @linger_ms 5_000
  @bad_file_descriptor 9
  @ns_per_ms 1_000_000

  @typedoc "The backend's module and the bus's name."
  @type key :: {module(), String.t()}

  @doc false
  def start_link({key, clock}),
    do: GenServer.start_link(__MODULE__, {key, clock, :shared}, name: via(key))

  @doc "Starts a process for one handle, which the registry does not list."
  @spec start_alone(key(), BB.Clock.t()) :: GenServer.on_start()
  def start_alone(key, clock), do: GenServer.start(__MODULE__, {key, clock, :alone})

  defp via(key), do: {:via, Registry, {Buses.registry(), key}}

  @impl GenServer
  def init({{backend, name} = key, clock, kind}) do
    {:ok,
     %{
       key: key,
       shared?: kind == :shared,
       backend: backend,
       name: name,
       clock: clock,
       bus: nil,
       timeout_ms: nil,
       handles: %{},
       recovery: Recovery.new(),
       reopened: 0,
       linger: nil
     }}
  end

  @impl GenServer
  def handle_call({:open, timeout_ms}, {owner, _tag}, state) do
    case state |> shorten_timeout(timeout_ms) |> ensure_openable() do
      {:ok, state} -> add_handle(owner, state)
      {error, state} -> {:reply, error, state, {:continue, :end_unless_used}}
    end
  end

  def handle_call({:transfer, ref, function, arguments}, _from, %{recovery: before} = state)
      when is_map_key(state.handles, ref) do
    {result, state} = state |> put_address(ref, hd(arguments)) |> transfer(function, arguments)
    {:reply, result, if(state.recovery == before, do: state, else: put_row(state))}
  end

  def handle_call({:transfer, _closed, _function, _arguments}, _from, state),
    do: {:reply, {:error, {:errno, @bad_file_descriptor}}, state}

  @impl GenServer
  def handle_cast({:close, ref}, state) do
    Process.demonitor(ref, [:flush])
    {:noreply, remove_handle(ref, state), {:continue, :end_unless_used}}
  end

  @impl GenServer
  def handle_info({:DOWN, ref, :process, _owner, _reason}, state),
    do: {:noreply, remove_handle(ref, state), {:continue, :end_unless_used}}

  def handle_info({:timeout, linger, :linger}, %{linger: linger} = state),
    do: {:stop, :normal, close_backend(state)}

  @impl GenServer
  def handle_continue(:end_unless_used, state) do
    cond do
      state.handles != %{} ->
        {:noreply, put_row(state)}

      state.shared? and Recovery.troubled?(state.recovery) ->
        {:noreply, state |> start_linger() |> put_row()}

      true ->
        {:stop, :normal, close_backend(state)}
    end
  end

  # Opening and closing.

  defp shorten_timeout(%{timeout_ms: nil} = state, timeout_ms),
    do: %{state | timeout_ms: timeout_ms}

  defp shorten_timeout(%{timeout_ms: current_ms} = state, timeout_ms)
       when timeout_ms >= current_ms,
       do: state

  defp shorten_timeout(%{recovery: %{phase: :up}} = state, timeout_ms),
    do: %{close_backend(state) | timeout_ms: timeout_ms, recovery: Recovery.new()}

  defp shorten_timeout(state, timeout_ms), do: %{state | timeout_ms: timeout_ms}

  # On Linux, too, a stuck bus opens without an error.
  defp ensure_openable(%{recovery: %{phase: :down, error: :timeout}} = state), do: {:ok, state}
  defp ensure_openable(state), do: ensure_open(state)

  defp ensure_open(state) do
    case Recovery.next_step(state.recovery, now_ms(state)) do
      :transfer -> {:ok, state}
      :open -> open_backend(state)
      {:error, error} -> {{:error, error}, state}
    end
  end

  defp open_backend(%{recovery: recovery} = state) do
    case call_backend(state.backend, :open, [state.name, [timeout: state.timeout_ms]]) do
      {:ok, bus} ->
        recovery = Recovery.opened(recovery)
        reopened = state.reopened + if(recovery.phase == :trying, do: 1, else: 0)
        {:ok, %{state | bus: bus, recovery: recovery, reopened: reopened}}

      {:error, error} ->
        recovery = Recovery.open_failed(recovery, error, now_ms(state))
        {{:error, error}, %{state | recovery: recovery}}

      exception ->
        {exception, state}
    end
  end

  defp close_backend(%{bus: nil} = state), do: state

  defp close_backend(state) do
    _ = call_backend(state.backend, :close, [state.bus])
    %{state | bus: nil}
  end

  # Transfers.

  defp transfer(state, function, arguments) do
    with {:ok, state} <- ensure_open(state) do
      result = call_backend(state.backend, function, [state.bus | arguments])
      {result, update_recovery(hd(arguments), result, state)}
    end
  end

  defp call_backend(backend, function, arguments) do
    apply(backend, function, arguments)
  rescue
    exception -> {:raise, exception, __STACKTRACE__}
  end

  # A boolean (device_present?/2) does not distinguish a NAK from a timeout.
  defp update_recovery(_address, result, state) when is_boolean(result), do: state
  defp update_recovery(_address, {:raise, _, _}, state), do: state

  defp update_recovery(address, result, %{recovery: before} = state) do
    in_use = addresses_in_use(result, state)

    case Recovery.transferred(before, address, result, in_use, now_ms(state)) do
      ^before -> state
      recovery -> put_recovery(before, recovery, state)
    end
  end

  defp put_recovery(before, %{phase: :down} = recovery, state) do
    if before.phase == :up, do: log_down(recovery, state)
    %{close_backend(state) | recovery: recovery}
  end

  defp put_recovery(before, recovery, state) do
    if before.phase == :trying and recovery.phase == :up, do: log_up(state)
    %{state | recovery: recovery}
  end

  # Only a timeout needs them.
  defp addresses_in_use({:error, :timeout}, state),
    do: state.handles |> Map.values() |> Enum.concat() |> Enum.uniq()

  defp addresses_in_use(_result, _state), do: []

  # Handles, each with the addresses that it has used.

  defp add_handle(owner, state) do
    ref = Process.monitor(owner)
    {:reply, {:ok, ref}, put_in(state.handles[ref], []) |> cancel_linger() |> put_row()}
  end

  defp remove_handle(ref, state), do: %{state | handles: Map.delete(state.handles, ref)}

  defp put_address(state, ref, address) do
    if address in state.handles[ref],
      do: state,
      else: update_in(state.handles[ref], &[address | &1])
  end

  defp start_linger(%{linger: nil} = state),
    do: %{state | linger: :erlang.start_timer(@linger_ms, self(), :linger)}

  defp start_linger(state), do: state

  defp cancel_linger(%{linger: nil} = state), do: state

  defp cancel_linger(state) do
    _ = :erlang.cancel_timer(state.linger)
    %{state | linger: nil}
  end

  # The row of BB.Bus.I2C.health/0.

  defp put_row(%{shared?: false} = state), do: state

  defp put_row(state) do
    {_, _} = Registry.update_value(Buses.registry(), state.key, fn _ -> row(state) end)
    state
  end

  defp row(state) do
    %{
      bus: state.name,
      backend: state.backend,
      state: state.recovery.phase,
      error: state.recovery.error,
      reopened: state.reopened,
      handles: map_size(state.handles)
    }
  end

  defp log_down(recovery, state) do
    Logger.warning(
      "bus #{state.name} closed: #{format_error(recovery.error)}; it is reopened until a " <>
        "device answers"
    )
  end

  defp log_up(state), do: Logger.info("bus #{state.name} is up again")

  defp format_error(:timeout), do: "transfers time out at every address"
  defp format_error(error), do: "the adapter is gone (#{inspect(error)})"

  defp now_ms(state), do: Integer.floor_div(BB.Clock.now_ns(state.clock), @ns_per_ms)
end

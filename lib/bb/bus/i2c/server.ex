defmodule BB.Bus.I2C.Server do
  @moduledoc """
  The process of one shared bus. Used through `BB.Bus.I2C`.

  It makes the transfers itself, so their order is that of its mailbox; `BB.Bus.I2C.Condition` decides when to close and open. Its row in
  `health/0` is the value of its entry in the registry: who reads it asks no process.

  Without handles it ends, unless there is trouble to remember: then it waits a while for its sensors to come back, so that those which are
  started again one after the other still count as the ones of one bus.

  When the application has ended, however it did, somebody may still have to make hardware safe. Then each handle has a process of its own,
  which no other shares and no health shows.
  """
  use GenServer, restart: :temporary
  use BB.Process.Tolerant

  alias BB.Bus.I2C.{Condition, Handle}
  alias BB.Bus.I2C.Supervisor, as: Buses

  require Logger

  @timeouts_ms 20..50
  @linger_ms 5_000

  # So long the buses may take to be restarted.
  @again_ms 5
  @tries 10
  @bad_file_descriptor 9
  @ns_per_ms 1_000_000

  @typedoc "The backend's module and the bus's name."
  @type key :: {module(), String.t()}

  @doc false
  def start_link({key, clock}),
    do: GenServer.start_link(__MODULE__, {key, clock, :shared}, name: via(key))

  @doc "Opens a bus for the caller; its process is started where there is none."
  @spec open(key(), %{timeout: integer(), retries: non_neg_integer(), clock: BB.Clock.t()}) ::
          {:ok, Handle.t()} | {:error, term()}
  def open(key, opts), do: open(key, opts, @tries)

  defp open({backend, name} = key, opts, tries) do
    timeout_ms = timeout_ms(opts.timeout)

    with {:ok, pid} <- server(key, opts.clock, tries),
         {:ok, ref} <- call(pid, {:open, timeout_ms}) do
      {:ok,
       %Handle{
         name: name,
         backend: backend,
         timeout_ms: timeout_ms,
         pid: pid,
         ref: ref,
         retries: opts.retries
       }}
    else
      {:error, reason} ->
        {:error, reason}

      :gone ->
        open(key, opts, tries)

      :away ->
        Process.sleep(@again_ms)
        open(key, opts, tries - 1)
    end
  end

  @doc "Makes a transfer: a function of the backend, with the bus and the address before `arguments`."
  @spec transfer(Handle.t(), atom(), term(), [term()]) :: term()
  def transfer(handle, function, address, arguments) do
    transfer = {function, address, arguments}

    with :gone <- call(handle.pid, {:transfer, handle.ref, transfer}) do
      if Buses.state() == :running,
        do: {:error, {:errno, @bad_file_descriptor}},
        else: transfer_alone(handle, transfer)
    end
  end

  # What ended was not the handle but the bus.
  defp transfer_alone(handle, transfer) do
    {:ok, pid} = start_alone({handle.backend, handle.name}, :real)

    with {:ok, ref} <- call(pid, {:open, handle.timeout_ms}) do
      answer = call(pid, {:transfer, ref, transfer})
      close(%{handle | pid: pid, ref: ref})
      answer
    end
  end

  @doc "Closes a handle."
  @spec close(Handle.t()) :: :ok
  def close(handle), do: GenServer.cast(handle.pid, {:close, handle.ref})

  @doc false
  def health do
    Buses.registry()
    |> Registry.select([{{:_, :_, :"$1"}, [{:is_map, :"$1"}], [:"$1"]}])
    |> Enum.sort_by(& &1.bus)
  end

  defp via(key), do: {:via, Registry, {Buses.registry(), key}}

  defp server(key, clock, 0), do: start_alone(key, clock)

  defp server(key, clock, _tries) do
    case Buses.state() do
      :running -> shared(key, clock)
      :restarting -> :away
      :ending -> start_alone(key, clock)
    end
  end

  defp start_alone(key, clock), do: GenServer.start(__MODULE__, {key, clock, :alone})

  defp shared(key, clock) do
    with [] <- Registry.lookup(Buses.registry(), key),
         {:ok, pid} <- Buses.start_server(key, clock) do
      {:ok, pid}
    else
      [{pid, _row}] -> {:ok, pid}
      {:error, {:already_started, pid}} -> {:ok, pid}
      # Its registry or its supervisor ends in this moment.
      {:error, _ended} -> :away
    end
  rescue
    ArgumentError -> :away
  catch
    :exit, _ended -> :away
  end

  # What the backend raises is the caller's mistake.
  defp call(pid, request) do
    case GenServer.call(pid, request, :infinity) do
      {:raise, exception, stacktrace} -> reraise exception, stacktrace
      answer -> answer
    end
  catch
    :exit, _ended -> :gone
  end

  defp timeout_ms(timeout) when timeout < 0, do: @timeouts_ms.last
  defp timeout_ms(timeout), do: timeout |> max(@timeouts_ms.first) |> min(@timeouts_ms.last)

  @impl GenServer
  def init({{backend, name} = key, clock, how}) do
    {:ok,
     %{
       key: key,
       shared?: how == :shared,
       backend: backend,
       name: name,
       clock: clock,
       bus: nil,
       timeout_ms: @timeouts_ms.last,
       handles: %{},
       condition: Condition.new(),
       reopened: 0,
       linger: nil
     }}
  end

  @impl GenServer
  def handle_call({:open, timeout_ms}, {owner, _tag}, state) do
    case state |> shorten(timeout_ms) |> reachable() do
      {:ok, state} -> opened(owner, state)
      {error, state} -> {:reply, error, state, {:continue, :remain}}
    end
  end

  def handle_call({:transfer, ref, transfer}, _from, %{condition: before} = state)
      when is_map_key(state.handles, ref) do
    {answer, state} = attempt(transfer, note_address(ref, transfer, state))

    {:reply, answer, if(state.condition == before, do: state, else: tell(state))}
  end

  def handle_call({:transfer, _closed, _transfer}, _from, state),
    do: {:reply, {:error, {:errno, @bad_file_descriptor}}, state}

  @impl GenServer
  def handle_cast({:close, ref}, state) do
    Process.demonitor(ref, [:flush])
    {:noreply, forget(ref, state), {:continue, :remain}}
  end

  @impl GenServer
  def handle_info({:DOWN, ref, :process, _owner, _reason}, state),
    do: {:noreply, forget(ref, state), {:continue, :remain}}

  def handle_info({:timeout, linger, :linger}, %{linger: linger} = state),
    do: {:stop, :normal, close_backend(state)}

  @impl GenServer
  def handle_continue(:remain, state) do
    cond do
      state.handles != %{} ->
        {:noreply, tell(state)}

      state.shared? and Condition.troubled?(state.condition) ->
        {:noreply, state |> linger() |> tell()}

      true ->
        {:stop, :normal, close_backend(state)}
    end
  end

  # Opening and closing.

  defp opened(owner, state) do
    ref = Process.monitor(owner)
    {:reply, {:ok, ref}, put_in(state.handles[ref], []) |> stay() |> tell()}
  end

  defp shorten(%{timeout_ms: now_ms} = state, timeout_ms) when timeout_ms >= now_ms, do: state

  defp shorten(%{condition: %{phase: :up}} = state, timeout_ms),
    do: %{close_backend(state) | timeout_ms: timeout_ms, condition: Condition.new()}

  defp shorten(state, timeout_ms), do: %{state | timeout_ms: timeout_ms}

  # Opening a stuck bus is no error on Linux either.
  defp reachable(%{condition: %{phase: :down, error: :timeout}} = state), do: {:ok, state}
  defp reachable(state), do: ready(state)

  defp ready(state) do
    case Condition.ask(state.condition, now_ms(state)) do
      :transfer -> {:ok, state}
      :open -> open_backend(state)
      {:error, error} -> {{:error, error}, state}
    end
  end

  defp open_backend(%{condition: condition} = state) do
    case guarded(fn -> state.backend.open(state.name, timeout: state.timeout_ms) end) do
      {:ok, bus} ->
        condition = Condition.opened(condition)
        reopened = state.reopened + if(condition.phase == :trying, do: 1, else: 0)
        {:ok, %{state | bus: bus, condition: condition, reopened: reopened}}

      {:error, error} ->
        condition = Condition.unopened(condition, error, now_ms(state))
        {{:error, error}, %{state | condition: condition}}

      mistake ->
        {mistake, state}
    end
  end

  defp close_backend(%{bus: nil} = state), do: state

  defp close_backend(state) do
    _ = guarded(fn -> state.backend.close(state.bus) end)
    %{state | bus: nil}
  end

  # Transfers.

  defp attempt(transfer, state) do
    case ready(state) do
      {:ok, state} -> make(transfer, state)
      {error, state} -> {error, state}
    end
  end

  defp make({function, address, arguments}, state) do
    answer = guarded(fn -> apply(state.backend, function, [state.bus, address | arguments]) end)

    {answer, heard(address, answer, state)}
  end

  # Who only asks whether somebody is there does not say what he heard.
  defp heard(_address, answer, state) when is_boolean(answer), do: state
  defp heard(_address, {:raise, _, _}, state), do: state

  defp heard(address, answer, %{condition: before} = state) do
    case Condition.heard(before, address, answer, in_use(answer, state), now_ms(state)) do
      ^before -> state
      condition -> turn(before, condition, state)
    end
  end

  defp turn(before, %{phase: :down} = condition, state) do
    if before.phase == :up, do: log_down(condition, state)
    %{close_backend(state) | condition: condition}
  end

  defp turn(before, condition, state) do
    if before.phase == :trying and condition.phase == :up, do: log_up(state)
    %{state | condition: condition}
  end

  defp note_address(ref, {_function, address, _arguments}, state) do
    if address in state.handles[ref],
      do: state,
      else: update_in(state.handles[ref], &[address | &1])
  end

  defp in_use({:error, :timeout}, state),
    do: state.handles |> Map.values() |> Enum.concat() |> Enum.uniq()

  defp in_use(_answer, _state), do: []

  defp guarded(fun) do
    fun.()
  rescue
    exception -> {:raise, exception, __STACKTRACE__}
  end

  # Handles.

  defp forget(ref, state), do: %{state | handles: Map.delete(state.handles, ref)}

  defp stay(%{linger: nil} = state), do: state

  defp stay(state) do
    _ = :erlang.cancel_timer(state.linger)
    %{state | linger: nil}
  end

  defp linger(%{linger: nil} = state),
    do: %{state | linger: :erlang.start_timer(@linger_ms, self(), :linger)}

  defp linger(state), do: state

  # What is known of the bus.

  defp tell(%{shared?: false} = state), do: state

  defp tell(state) do
    {_, _} = Registry.update_value(Buses.registry(), state.key, fn _ -> row(state) end)
    state
  end

  defp row(state) do
    %{
      bus: state.name,
      backend: state.backend,
      state: state.condition.phase,
      error: state.condition.error,
      reopened: state.reopened,
      handles: map_size(state.handles)
    }
  end

  defp log_down(condition, state) do
    Logger.warning(
      "the bus #{state.name} is closed and will be opened anew until a device answers: #{words(condition.error)}"
    )
  end

  defp log_up(state), do: Logger.info("the bus #{state.name} is up again")

  defp words(:timeout), do: "it is held, whichever device is asked"
  defp words(error), do: "its adapter is gone (#{inspect(error)})"

  defp now_ms(state), do: Integer.floor_div(BB.Clock.now_ns(state.clock), @ns_per_ms)
end

defmodule BB.Firmware.Gate.LockServer do
  @moduledoc """
  The process with the lock for writing a firmware (`BB.Firmware.Gate.Lock`). It belongs to no
  supervisor and no application, so that two uploads exclude each other also on a board whose
  gate, robot and application have ended.

  Its registered name makes it unique. It lives as long as an upload runs, or may just have
  written. The uploader gets a registered name too: when the lock server is killed, a new one
  finds the uploader by that name and continues with it.

  While the lock server lives, the robots cannot be armed (`BB.Safety.inhibit/3` at
  `[:firmware, :update]`).
  """
  @moduledoc no_example: "internal: BB.Firmware.Gate is its interface"

  use GenServer
  use BB.Process.Tolerant

  alias BB.Firmware.Gate.Lock
  alias BB.Safety

  @path [:firmware, :update]
  @attempts 5
  # Longer than any settling time.
  @call_timeout_ms 30_000

  @typedoc "The registered names of the lock server and of the uploader."
  @type names :: {lock :: atom(), uploader :: atom()}

  @typedoc """
  The names, the robots that cannot be armed meanwhile, and the time for which the lock stays
  closed after an upload.
  """
  @type settings :: %{
          required(:names) => names(),
          required(:robots) => [module()],
          required(:settle_ms) => non_neg_integer(),
          optional(atom()) => term()
        }

  @doc """
  Gives the lock to the calling process. Waits while it is unknown whether the upload before has
  written a firmware.
  """
  @spec enter(settings()) :: :ok | {:error, :updating | :written | :unknown}
  def enter(settings) do
    adopt(settings)
    enter(settings, self(), @attempts)
  end

  defp enter(_settings, _uploader, 0), do: {:error, :unknown}

  defp enter(%{names: {lock, name}} = settings, uploader, attempts) do
    answer =
      case start(uploader, settings) do
        {:ok, _pid} -> :ok
        {:error, {:already_started, _pid}} -> call(lock, {:enter, uploader})
      end

    case answer do
      :ok -> name(uploader, name)
      :not_running -> enter(settings, uploader, attempts - 1)
      refused -> refused
    end
  end

  @doc "Releases the lock of the calling process, which has written nothing."
  @spec leave(settings()) :: :ok
  def leave(%{names: {lock, name}}) do
    _ = if Process.whereis(name) == self(), do: Process.unregister(name)
    _ = call(lock, {:leave, self()})
    :ok
  end

  @doc "Closes the lock for good, because a firmware was written."
  @spec written(settings()) :: :ok
  def written(%{names: {lock, _name}} = settings) do
    with :not_running <- call(lock, :written) do
      _ = start(:nobody, settings)
      _ = call(lock, :written)
      :ok
    end
  end

  @doc "Returns the state of the lock."
  @spec lock(names()) :: Lock.t()
  def lock({lock, name}) do
    case {call(lock, :lock), Process.whereis(name)} do
      {:not_running, nil} -> :free
      {:not_running, uploader} -> {:held, uploader}
      {state, _uploader} -> state
    end
  end

  @doc """
  Starts a lock server for an uploader whose lock server was killed, and forbids arming again
  while a lock server runs. Returns `:free` without uploader and lock server.
  """
  @spec adopt(settings()) :: :held | :free
  def adopt(%{names: {lock, name}} = settings) do
    uploader = Process.whereis(name)
    lock = Process.whereis(lock)
    _ = if lock == nil and uploader not in [nil, self()], do: start(uploader, settings)

    if lock || uploader not in [nil, self()] do
      inhibit(settings.robots)
      :held
    else
      :free
    end
  end

  @doc "Forbids arming. Ignores a robot while safety does not run, which cannot be armed then."
  @spec inhibit([module()]) :: :ok
  def inhibit(robots), do: each(robots, &Safety.inhibit(&1, @path, :update))

  @doc "Allows arming again."
  @spec allow([module()]) :: :ok
  def allow(robots), do: each(robots, &Safety.allow(&1, @path))

  # The tables of safety may not exist.
  defp each(robots, fun) do
    Enum.each(robots, fn robot ->
      try do
        fun.(robot)
      rescue
        ArgumentError -> :ok
      end
    end)
  end

  defp start(uploader, %{names: {lock, _name}} = settings),
    do: GenServer.start(__MODULE__, {uploader, settings}, name: lock)

  defp call(lock, request) do
    GenServer.call(lock, request, @call_timeout_ms)
  catch
    :exit, _reason -> :not_running
  end

  defp name(pid, name) do
    true = Process.register(pid, name)
    :ok
  rescue
    # The process has ended already, or has a name of its own.
    ArgumentError -> :ok
  end

  @impl GenServer
  def init({uploader, settings}) do
    # The end of an application kills all processes with its group leader.
    Process.group_leader(self(), Process.whereis(:init))
    inhibit(settings.robots)
    {:ok, put_holder(%{lock: :free, waiting: [], settings: settings}, uploader)}
  end

  defp put_holder(state, :nobody), do: state

  defp put_holder(state, uploader) do
    _ = Process.monitor(uploader)
    {:ok, lock} = Lock.enter(:free, uploader, now_ms())
    %{state | lock: lock}
  end

  @impl GenServer
  def handle_call({:enter, uploader}, from, state) do
    case Lock.enter(state.lock, uploader, now_ms()) do
      {:ok, _lock} -> {:reply, :ok, put_holder(state, uploader)}
      {:error, :closing} -> {:noreply, %{state | waiting: state.waiting ++ [{from, uploader}]}}
      {:error, refusal} -> {:reply, {:error, refusal}, state}
    end
  end

  def handle_call({:leave, uploader}, from, %{lock: {:held, uploader}} = state) do
    GenServer.reply(from, :ok)
    give_to_next(%{state | lock: :free})
  end

  def handle_call({:leave, _other}, _from, state), do: {:reply, :ok, state}

  def handle_call(:written, _from, state) do
    for {from, _uploader} <- state.waiting, do: GenServer.reply(from, {:error, :written})
    {:reply, :ok, %{state | lock: Lock.written(state.lock), waiting: []}}
  end

  def handle_call(:lock, _from, state), do: {:reply, state.lock, state}

  @impl GenServer
  def handle_info({:DOWN, _ref, :process, pid, _reason}, state) do
    settle_ms = state.settings.settle_ms
    lock = Lock.handle_down(state.lock, pid, now_ms(), settle_ms)
    _ = if lock != state.lock, do: Process.send_after(self(), :settled, settle_ms)
    {:noreply, %{state | lock: lock}}
  end

  def handle_info(:settled, state) do
    case Lock.handle_timeout(state.lock, now_ms()) do
      :free -> give_to_next(%{state | lock: :free})
      lock -> {:noreply, %{state | lock: lock}}
    end
  end

  # The first waiting uploader gets the lock. Without one the lock server ends.
  defp give_to_next(%{waiting: []} = state) do
    allow(state.settings.robots)
    {:stop, :normal, state}
  end

  defp give_to_next(%{waiting: [{from, uploader} | rest]} = state) do
    GenServer.reply(from, :ok)
    for {from, _uploader} <- rest, do: GenServer.reply(from, {:error, :updating})
    {:noreply, put_holder(%{state | waiting: []}, uploader)}
  end

  defp now_ms, do: System.monotonic_time(:millisecond)
end

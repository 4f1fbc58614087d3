defmodule BB.Bus.I2C.Client do
  @moduledoc """
  Calls the process of a bus, and starts it where it does not run.

  `BB.Bus.I2C` uses it. After the application has ended, however it did, each handle gets a
  process of its own, so that a `disarm/1` can still make hardware safe. `BB.Bus.I2C.health/0`
  does not list such a process.
  """
  @moduledoc no_example: "internal: BB.Bus.I2C is its interface"

  alias BB.Bus.I2C.Server
  alias BB.Bus.I2C.Supervisor, as: Buses

  # For as long the restart of the bus processes may last.
  @retry_ms 5
  @tries 10
  @bad_file_descriptor 9

  @doc "Opens a bus for the caller. The result names its process and the handle there."
  @spec open(Server.key(), pos_integer(), BB.Clock.t()) ::
          {:ok, pid(), reference()} | {:error, term()}
  def open(key, timeout_ms, clock), do: open(key, timeout_ms, clock, @tries)

  defp open(key, timeout_ms, clock, tries) do
    with {:ok, pid} <- find_or_start(key, clock, tries),
         {:ok, ref} <- call(pid, {:open, timeout_ms}) do
      {:ok, pid, ref}
    else
      {:error, reason} ->
        {:error, reason}

      :ended ->
        open(key, timeout_ms, clock, tries)

      :restarting ->
        Process.sleep(@retry_ms)
        open(key, timeout_ms, clock, tries - 1)
    end
  end

  @doc "Makes a transfer: calls `function` of the backend with its bus and `arguments`."
  @spec transfer(BB.Bus.I2C.t(), atom(), [term(), ...]) :: term()
  def transfer(bus, function, arguments) do
    with :ended <- call(bus.pid, {:transfer, bus.ref, function, arguments}) do
      if Buses.state() == :running,
        do: {:error, {:errno, @bad_file_descriptor}},
        else: transfer_alone(bus, function, arguments)
    end
  end

  # The application has ended, and its process with it. The handle is still valid.
  defp transfer_alone(bus, function, arguments) do
    {:ok, pid} = Server.start_alone({bus.backend, bus.name}, :real)

    with {:ok, ref} <- call(pid, {:open, bus.timeout_ms}) do
      result = call(pid, {:transfer, ref, function, arguments})
      close(%{bus | pid: pid, ref: ref})
      result
    end
  end

  @doc "Closes a handle."
  @spec close(BB.Bus.I2C.t()) :: :ok
  def close(bus), do: GenServer.cast(bus.pid, {:close, bus.ref})

  defp find_or_start(key, clock, 0), do: Server.start_alone(key, clock)

  defp find_or_start(key, clock, _tries) do
    case Buses.state() do
      :running -> find_or_start_shared(key, clock)
      :restarting -> :restarting
      :ending -> Server.start_alone(key, clock)
    end
  end

  defp find_or_start_shared(key, clock) do
    with [] <- Registry.lookup(Buses.registry(), key),
         {:ok, pid} <- Buses.start_server(key, clock) do
      {:ok, pid}
    else
      [{pid, _row}] -> {:ok, pid}
      {:error, {:already_started, pid}} -> {:ok, pid}
      # The registry or the supervisor ended during the start.
      {:error, _ended} -> :restarting
    end
  rescue
    ArgumentError -> :restarting
  catch
    :exit, _ended -> :restarting
  end

  # An exception of the backend is raised in the caller, whose arguments are wrong.
  defp call(pid, request) do
    case GenServer.call(pid, request, :infinity) do
      {:raise, exception, stacktrace} -> reraise exception, stacktrace
      answer -> answer
    end
  catch
    :exit, _ended -> :ended
  end
end

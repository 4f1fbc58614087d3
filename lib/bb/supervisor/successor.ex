defmodule BB.Supervisor.Successor do
  @moduledoc """
  Starts a supervisor anew although the one before it was killed a moment ago.

  Processes that a killed supervisor leaves behind keep their names until they have ended too. A start that meets one of them
  waits for its end, instead of failing over and over and using up the restarts of the robot's root.
  """

  @tries 10
  @wait_ms 1_000

  @doc "The child specification of `child` with a start that waits for a predecessor's processes."
  @spec child_spec(Supervisor.child_spec() | {module(), term()}) :: Supervisor.child_spec()
  def child_spec(child) do
    spec = Supervisor.child_spec(child, [])
    %{spec | start: {__MODULE__, :start_link, [spec.start, @tries]}}
  end

  @doc "Starts what `mfa` starts."
  @spec start_link({module(), atom(), [term()]}, pos_integer()) :: Supervisor.on_start()
  def start_link({module, function, arguments}, 1), do: apply(module, function, arguments)

  def start_link({module, function, arguments} = mfa, tries) do
    case apply(module, function, arguments) do
      {:error, {:shutdown, {:failed_to_start_child, _id, {:already_started, pid}}}} ->
        await_end(pid)
        start_link(mfa, tries - 1)

      {:error, {:already_started, pid}} ->
        await_end(pid)
        start_link(mfa, tries - 1)

      started ->
        started
    end
  end

  defp await_end(pid) do
    ref = Process.monitor(pid)

    receive do
      {:DOWN, ^ref, :process, ^pid, _reason} -> :ok
    after
      @wait_ms -> Process.demonitor(ref, [:flush])
    end
  end
end

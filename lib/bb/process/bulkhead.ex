defmodule BB.Process.Bulkhead do
  @longest_ms 1_000
  @calm_ms 5_000

  @moduledoc """
  A supervisor of one child that restarts it forever and never fails itself.

  Use it between a supervisor and children that must not spend each other's restarts:

      children = [Bulkhead.child_spec(Guard), Bulkhead.child_spec(MyRobot)]
      Supervisor.start_link(children, strategy: :one_for_one)

  However often the child ends, the bulkhead starts it again. The first restarts are immediate.
  The pause before further ones doubles each time, up to #{@longest_ms} ms, so that a failing
  child does not use up the machine. A child that has run for #{@calm_ms} ms is restarted at once
  again. A start waits for the processes that a killed predecessor has left behind
  (`BB.Process.Successor`).

  The first start fails if the child's does: a mistake in its options would only repeat itself.
  """

  use Supervisor

  alias BB.Process.Successor

  # More restarts than the pauses allow.
  @restarts [max_restarts: 1_000, max_seconds: 1]

  @doc "Returns the child specification of `child` with a bulkhead around it, under the same id."
  @spec child_spec(Supervisor.child_spec() | {module(), term()} | module()) ::
          Supervisor.child_spec()
  def child_spec(child) do
    child = Supervisor.child_spec(child, [])
    start = {__MODULE__, :start_link, [child]}
    Successor.child_spec(%{id: child.id, start: start, type: :supervisor})
  end

  @doc false
  @spec start_link(Supervisor.child_spec()) :: Supervisor.on_start()
  def start_link(child), do: Supervisor.start_link(__MODULE__, child)

  @impl Supervisor
  def init(child) do
    child = %{child | start: {__MODULE__, :start_child, [child.start]}}
    Supervisor.init([child], [strategy: :one_for_one] ++ @restarts)
  end

  @doc false
  @spec start_child({module(), atom(), [term()]}) :: Supervisor.on_start()
  def start_child(start) do
    {started_ms, waited_ms} = Process.get(__MODULE__, {nil, 0})
    wait_ms = wait_ms(started_ms && now_ms() - started_ms, waited_ms)
    Process.sleep(wait_ms)
    Process.put(__MODULE__, {now_ms(), wait_ms})
    Successor.start_link(start)
  end

  @doc """
  Returns the pause before a start, given the last one's pause `waited_ms` and its age `ago_ms`.

      iex> BB.Process.Bulkhead.wait_ms(nil, 0)
      0
      iex> Enum.scan(1..12, 0, fn _n, waited -> BB.Process.Bulkhead.wait_ms(200, waited) end)
      [1, 2, 4, 8, 16, 32, 64, 128, 256, 512, 1000, 1000]
      iex> BB.Process.Bulkhead.wait_ms(5_000, 1_000)
      0
  """
  @spec wait_ms(non_neg_integer() | nil, non_neg_integer()) :: non_neg_integer()
  def wait_ms(nil, _waited_ms), do: 0
  def wait_ms(ago_ms, _waited_ms) when ago_ms >= @calm_ms, do: 0
  def wait_ms(_ago_ms, waited_ms), do: min(max(2 * waited_ms, 1), @longest_ms)

  defp now_ms, do: System.monotonic_time(:millisecond)
end

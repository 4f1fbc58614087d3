defmodule BB.Test.Gaps do
  @moduledoc """
  Listens to all `BB.Test.Counter`s of a robot, and reports each number that is missing or
  repeated.
  """

  use GenServer

  alias BB.Test.Counter.Count

  @doc "Starts to listen."
  def start_link(robot), do: GenServer.start_link(__MODULE__, robot)

  @doc "Returns the report: `{%{path => last number}, [{path, expected, got}]}`."
  def report(pid), do: GenServer.call(pid, :report, :infinity)

  @impl GenServer
  def init(robot) do
    {:ok, _} = BB.subscribe(robot, [:sensor], message_types: [Count])
    {:ok, {%{}, []}}
  end

  @impl GenServer
  def handle_call(:report, _from, state), do: {:reply, state, state}

  @impl GenServer
  def handle_info({:bb, path, %{payload: %Count{n: n}}}, {last, gaps}) do
    expected = Map.get(last, path, n - 1) + 1
    gaps = if n == expected, do: gaps, else: [{path, expected, n} | gaps]
    {:noreply, {Map.put(last, path, n), gaps}}
  end
end

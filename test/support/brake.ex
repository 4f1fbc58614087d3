defmodule BB.Test.Brake do
  @moduledoc """
  A component with a scripted `disarm/1`, whose calls are counted.

      Brake.script(robot, [:base, :brake], disarm: fn _opts -> {:error, :stuck} end)
      Brake.runs(robot, [:base, :brake])

  Without a script, `init/1` and `disarm/1` return `:ok`. The count is outside of every process
  that a test might kill.
  """

  use BB.Sensor, options_schema: [force: [type: :pos_integer, default: 10]]

  @table __MODULE__

  @doc "Makes the table, once, in a process that outlives all tests."
  def setup, do: :ets.new(@table, [:named_table, :public])

  @doc "Sets callbacks."
  def script(robot, path, callbacks) do
    for {callback, fun} <- callbacks, do: :ets.insert(@table, {{robot, path, callback}, fun})
    :ok
  end

  @doc "Returns how often its `disarm/1` has been called."
  def runs(robot, path), do: :ets.update_counter(@table, {robot, path}, 0, {{robot, path}, 0})

  @doc "Registers a brake without a component, for the calling process."
  def register(robot, path),
    do: BB.Safety.register(__MODULE__, robot: robot, path: path, opts: options(robot, path))

  @doc "Registers a brake without a component, for a new process, which it returns."
  def register_apart(robot, path) do
    test = self()

    owner =
      spawn(fn ->
        send(test, {self(), register(robot, path)})
        Process.sleep(:infinity)
      end)

    receive do: ({^owner, :ok} -> owner)
  end

  defp options(robot, path), do: [bb: %{robot: robot, path: path}]

  @impl BB.Sensor
  def init(opts), do: run(opts, :init, {:ok, opts})

  @impl BB.Sensor
  def disarm(opts) do
    %{robot: robot, path: path} = opts[:bb]
    :ets.update_counter(@table, {robot, path}, 1, {{robot, path}, 0})
    run(opts, :disarm, :ok)
  end

  @impl BB.Sensor
  def handle_cast(:crash, _state), do: exit(:crash)

  defp run(opts, callback, default) do
    case :ets.lookup(@table, {opts[:bb].robot, opts[:bb].path, callback}) do
      [{_key, fun}] -> fun.(opts)
      [] -> default
    end
  end
end

defmodule BB.Test.Caliper do
  @moduledoc "A `BB.Test.Brake` that is an actuator."

  use BB.Actuator, options_schema: [force: [type: :pos_integer, default: 10]]

  alias BB.Test.Brake

  @impl BB.Actuator
  defdelegate init(opts), to: Brake

  @impl BB.Actuator
  defdelegate disarm(opts), to: Brake

  @impl BB.Actuator
  def handle_command(_message, state), do: {:noreply, state}

  @impl BB.Actuator
  defdelegate handle_cast(request, state), to: Brake
end

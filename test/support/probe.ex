defmodule BB.Test.Probe do
  @moduledoc """
  A sensor with scripted callbacks.

      Probe.script(robot, :imu, init: fn _opts -> {:stop, :absent} end)

  Callbacks without a script are those of `use BB.Sensor`; `init` returns `{:ok, opts[:bb]}`.
  Scripts may change at any time. The functions capture the test's pid, because options of a robot
  cannot contain it.
  """

  use BB.Sensor, options_schema: [rate: [type: :pos_integer, default: 100]]

  @table __MODULE__

  @doc "Makes the table of scripts, once, in a process that outlives all tests."
  def setup, do: :ets.new(@table, [:named_table, :public, read_concurrency: true])

  @doc "Sets the callbacks of the robot's sensor with that name."
  def script(robot, name, callbacks) do
    for {callback, fun} <- callbacks,
        do: :ets.insert(@table, {{robot, name, callback}, fun})

    :ok
  end

  @impl BB.Sensor
  def init(opts) do
    Process.put(@table, {opts[:bb].robot, List.last(opts[:bb].path)})
    run(:init, [opts], fn -> {:ok, opts[:bb]} end)
  end

  @impl BB.Sensor
  def handle_call(request, from, state),
    do: run(:handle_call, [request, from, state], fn -> super(request, from, state) end)

  @impl BB.Sensor
  def handle_cast(request, state),
    do: run(:handle_cast, [request, state], fn -> super(request, state) end)

  @impl BB.Sensor
  def handle_info(message, state),
    do: run(:handle_info, [message, state], fn -> super(message, state) end)

  @impl BB.Sensor
  def handle_continue(argument, state),
    do: run(:handle_continue, [argument, state], fn -> super(argument, state) end)

  @impl BB.Sensor
  def handle_options(options, state),
    do: run(:handle_options, [options, state], fn -> super(options, state) end)

  @impl BB.Sensor
  def terminate(reason, state),
    do: run(:terminate, [reason, state], fn -> super(reason, state) end)

  defp run(callback, arguments, default) do
    {robot, name} = Process.get(@table)

    case :ets.lookup(@table, {robot, name, callback}) do
      [{_, fun}] -> apply(fun, arguments)
      [] -> default.()
    end
  end
end

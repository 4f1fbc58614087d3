defmodule BB.Test.Bench do
  @moduledoc """
  Runs a driver without a robot, with a pubsub and a simulated bus of its own.

      bench = Bench.new(BB.Sensor.Ina219, %{0x40 => {BB.Bus.Sim.Ina219, []}})
      pid = Bench.start!(bench, rate: 100)
      %PowerState{} = Bench.reading().payload
  """
  import ExUnit.Assertions
  import ExUnit.Callbacks

  alias BB.Bus.Sim

  @enforce_keys [:driver, :robot, :bus]
  defstruct [:driver, :robot, :bus, path: [:bench, :sensor]]

  @patience_ms 60_000
  @id :driver

  @doc """
  Returns a bench for a driver and its devices. The calling process receives the driver's
  messages.
  """
  def new(driver, devices) do
    unique = System.unique_integer([:positive])
    robot = Module.concat(driver, "Bench#{unique}")
    bus = "i2c-bench-#{unique}"
    start_supervised!({BB.PubSub, robot})
    {:ok, _} = BB.PubSub.subscribe(robot, [:sensor])
    start_supervised!({Sim, buses: %{bus => [devices: devices]}})
    %__MODULE__{driver: driver, robot: robot, bus: bus}
  end

  @doc "Starts the driver: `{:ok, pid}`, or `{:error, reason}` with the driver's own reason."
  def start(bench, opts \\ []) do
    child =
      Supervisor.child_spec({BB.Sensor.Server, args(bench, opts)}, id: @id, restart: :temporary)

    case start_supervised(child) do
      {:ok, pid} -> {:ok, pid}
      {:error, {reason, _child}} -> {:error, reason}
    end
  end

  @doc "Starts the driver, and returns its process."
  def start!(bench, opts \\ []) do
    assert {:ok, pid} = start(bench, opts)
    pid
  end

  @doc "Stops the driver as its supervisor would."
  def stop, do: stop_supervised!(@id)

  @doc "Returns the driver's options as its `init/1` gets them."
  def options(bench, opts) do
    {own, opts} = Keyword.split(args(bench, opts), [:__callback_module__, :bb])
    {:ok, opts} = BB.Options.validate(opts, bench.driver.options_schema())
    [bb: own[:bb]] ++ opts
  end

  @doc "Returns the next message."
  def reading do
    assert_receive {:bb, [:sensor, :bench, :sensor], %BB.Message{} = message}, @patience_ms
    message
  end

  @doc "Returns the next message for which `fun` returns true."
  def reading(fun) do
    message = reading()
    if fun.(message), do: message, else: reading(fun)
  end

  @doc "Calls `fun` while no reading is in progress, and discards all earlier messages."
  def between_readings(pid, fun) do
    :ok = :sys.suspend(pid)
    result = fun.()
    forget()
    :ok = :sys.resume(pid)
    result
  end

  @doc """
  Returns the reason with which a working driver ends after `fault`.

  `fault` runs between two readings. No message that was published after it remains.
  """
  def reason_after(pid, fault) do
    reading()
    reason = reason_of_end(pid, fn -> between_readings(pid, fault) end)
    refute_received {:bb, _, _}
    reason
  end

  @doc """
  Calls `fun` and returns the reason with which the process ends. Its messages arrive before that.
  """
  def reason_of_end(pid, fun \\ fn -> :ok end) do
    monitor = Process.monitor(pid)
    fun.()
    assert_receive {:DOWN, ^monitor, :process, ^pid, reason}, @patience_ms
    reason
  end

  @doc "Replaces the device at an address."
  def replace(bench, address, device) do
    :ok = Sim.unplug(bench.bus, address)
    :ok = Sim.plug(bench.bus, address, device)
  end

  @doc "Pulls the chip's wires and restores them: the chip is as after power-on."
  def cut_power(bench, address) do
    :ok = Sim.unplug(bench.bus, address)
    :ok = Sim.replug(bench.bus, address)
  end

  defp forget do
    receive do
      {:bb, _path, _message} -> forget()
    after
      0 -> :ok
    end
  end

  defp args(bench, opts) do
    defaults = if bus_option?(bench), do: [bus: bench.bus], else: []

    [__callback_module__: bench.driver, bb: %{robot: bench.robot, path: bench.path}] ++
      Keyword.merge(defaults, opts)
  end

  defp bus_option?(bench) do
    %{schema: schema} = BB.Options.new!(bench.driver.options_schema())
    Keyword.has_key?(schema, :bus)
  end
end

defmodule BB.Bus.Sim.Wiring do
  @moduledoc """
  What a robot declares of one simulated bus, or of one chip of lines, while the robot runs: it
  starts the bus where there is none, and wires the robot's devices to it.

      {BB.Bus.Sim.Wiring, {MyRobot, :i2c, "i2c-1", devices: [{0x68, {BB.Bus.Sim.Mpu6050, []}}]}}

  A bus that is there is used as it is: one of the configuration (`simulated_buses:`), of a test, or
  of another robot. Then

    * a device goes to a place that is free,
    * one that another robot has declared in the same way is shared,
    * one that somebody else than a robot has put there stays, and the robot's is left out,
    * another robot's other device there is an error, which fails the start and says whose it is.

  When the bus ends, so does this process: the one that is started in its place makes the bus anew,
  with the robot's devices as after power-on. It takes its devices off when the robot stops. The time
  of a bus is that of the robot that has made it (`BB.Clock.of/1`).
  """
  use GenServer
  use BB.Process.Tolerant

  alias BB.Bus.Sim.Server
  alias BB.Bus.Sim.GPIO.Chip

  require Logger

  @servers %{i2c: Server, gpio: Chip}

  @typedoc "The robot, the kind of bus, its name, and its options with `devices:`, a list."
  @type argument :: {module(), :i2c | :gpio, String.t(), keyword()}

  @doc "The child specification; its id is the kind and name of the bus."
  @spec child_spec(argument()) :: Supervisor.child_spec()
  def child_spec({_robot, kind, name, _opts} = argument),
    do: %{id: {kind, name}, start: {__MODULE__, :start_link, [argument]}}

  @doc "Starts it, linked to the caller."
  @spec start_link(argument()) :: GenServer.on_start()
  def start_link(argument), do: GenServer.start_link(__MODULE__, argument)

  @impl GenServer
  def init({robot, kind, name, opts}) do
    # So that terminate/2 runs.
    Process.flag(:trap_exit, true)
    {devices, opts} = Keyword.pop(opts, :devices, [])
    state = %{robot: robot, kind: kind, name: name, bus: nil, own?: false, ref: nil}

    case connect(state, opts, devices) do
      {:ok, state} -> {:ok, state}
      {:error, exception} -> {:stop, exception}
    end
  end

  @impl GenServer
  def handle_info({:DOWN, ref, :process, _bus, _reason}, %{ref: ref} = state),
    do: {:stop, {:shutdown, :bus_ended}, %{state | bus: nil}}

  @impl GenServer
  def terminate(_reason, %{bus: nil}), do: :ok

  def terminate(_reason, %{own?: true} = state) do
    Process.exit(state.bus, :shutdown)
    await_end(state)
  end

  def terminate(_reason, state), do: ask(state, {:unwire, state.robot})

  # A bus that ends in this moment, with the robot that has made it, is made anew.
  defp connect(state, opts, devices) do
    with {:ok, state} <- attach(state, opts) do
      case wire_all(devices, state) do
        :ok -> {:ok, state}
        :bus_ended -> connect(await_end(state), opts, devices)
        error -> error
      end
    end
  end

  defp await_end(%{ref: ref} = state) do
    receive do: ({:DOWN, ^ref, :process, _bus, _reason} -> %{state | bus: nil, own?: false})
  end

  defp attach(state, opts) do
    opts = [clock: BB.Clock.of(state.robot)] ++ opts

    case @servers[state.kind].start_link({state.name, opts}) do
      {:ok, bus} -> {:ok, watch(%{state | own?: true}, bus)}
      {:error, {:already_started, bus}} -> {:ok, watch(state, bus)}
      {:error, exception} when is_exception(exception) -> {:error, exception}
      {:error, reason} -> {:error, failure(state, "cannot be started", reason)}
    end
  end

  defp watch(state, bus), do: %{state | bus: bus, ref: Process.monitor(bus)}

  defp wire_all(devices, state) do
    Enum.find_value(devices, :ok, fn {place, device} ->
      case ask(state, {:wire, place, device, state.robot}) do
        :ok -> nil
        :kept -> keep(place, state)
        {:taken, present, robot} -> {:error, conflict(place, present, robot, state)}
        {:raise, exception} -> {:error, exception}
        {:error, reason} -> {:error, failure(state, "has no device at #{at(place)}", reason)}
        :bus_ended -> :bus_ended
      end
    end)
  end

  defp ask(state, request) do
    GenServer.call(state.bus, request, :infinity)
  catch
    :exit, _reason -> :bus_ended
  end

  defp keep(place, state) do
    Logger.debug(
      "#{inspect(state.robot)}: the device at #{at(place)} of #{named(state)} is not the robot's"
    )

    nil
  end

  defp conflict(place, {module, _opts}, robot, state) do
    ArgumentError.exception(
      "#{named(state)} has another device at #{at(place)}: a #{inspect(module)} that " <>
        "#{inspect(robot)} declares; give #{inspect(state.robot)} another bus or place in its " <>
        "`simulation`, or declare the same device in both"
    )
  end

  defp failure(state, what, reason),
    do: RuntimeError.exception("#{named(state)} #{what}: #{inspect(reason)}")

  defp named(%{kind: :i2c, name: name}), do: "the simulated bus #{name}"
  defp named(%{kind: :gpio, name: name}), do: "the simulated chip #{name}"

  defp at(address) when is_integer(address), do: "0x" <> Integer.to_string(address, 16)
  defp at(name), do: inspect(name)
end

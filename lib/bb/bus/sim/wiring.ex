defmodule BB.Bus.Sim.Wiring do
  @moduledoc """
  The process that wires a robot's devices to one simulated bus, or to one chip of lines, while
  the robot runs.

  The robot's supervisor starts one for each bus of its `simulation`.

      {BB.Bus.Sim.Wiring, {MyRobot, :i2c, "i2c-1", devices: [{0x68, {BB.Bus.Sim.Mpu6050, []}}]}}

  It starts the bus where none of that name runs. A bus that runs is used as it is: one of the
  configuration (`simulated_buses:`), of a test, or of another robot. Then

    * a device is plugged into a place that is free;
    * a device that another robot declares in the same way is shared;
    * a device that no robot declares stays, and the robot's is left out;
    * a different device of another robot fails the start, with an error that names that robot.

  When the bus ends, this process ends too. The process that replaces it starts the bus again,
  with the robot's devices as after power-on. When the robot stops, its devices are removed. A bus
  has the clock of the robot that started it (`BB.Clock.of/1`).
  """
  use GenServer
  use BB.Process.Tolerant

  alias BB.Bus.Sim

  require Logger

  @servers %{i2c: Sim.Server, gpio: Sim.GPIO.Server}

  @typedoc "The robot, the kind of bus, its name, and its options with `devices:`, a list."
  @type argument :: {module(), :i2c | :gpio, String.t(), keyword()}

  @doc "Returns the child specification, with the kind and the name of the bus as its id."
  @spec child_spec(argument()) :: Supervisor.child_spec()
  def child_spec({_robot, kind, name, _opts} = argument),
    do: %{id: {kind, name}, start: {__MODULE__, :start_link, [argument]}}

  @doc "Starts the process, linked to the caller."
  @spec start_link(argument()) :: GenServer.on_start()
  def start_link(argument), do: GenServer.start_link(__MODULE__, argument)

  @impl GenServer
  def init({robot, kind, name, opts}) do
    # So that terminate/2 runs.
    Process.flag(:trap_exit, true)
    {devices, opts} = Keyword.pop(opts, :devices, [])
    state = %{robot: robot, kind: kind, name: name, bus: nil, started?: false, ref: nil}

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

  def terminate(_reason, %{started?: true} = state) do
    Process.exit(state.bus, :shutdown)
    await_end(state)
  end

  def terminate(_reason, state), do: call(state, {:unwire, state.robot})

  # A bus that ends now, with the robot that started it, is started again.
  defp connect(state, opts, devices) do
    with {:ok, state} <- find_or_start(state, opts) do
      case wire_all(devices, state) do
        :ok -> {:ok, state}
        :bus_ended -> connect(await_end(state), opts, devices)
        error -> error
      end
    end
  end

  defp await_end(%{ref: ref} = state) do
    receive do: ({:DOWN, ^ref, :process, _bus, _reason} -> %{state | bus: nil, started?: false})
  end

  defp find_or_start(state, opts) do
    opts = [clock: BB.Clock.of(state.robot)] ++ opts

    case @servers[state.kind].start_link({state.name, opts}) do
      {:ok, bus} -> {:ok, monitor(%{state | started?: true}, bus)}
      {:error, {:already_started, bus}} -> {:ok, monitor(state, bus)}
      {:error, exception} when is_exception(exception) -> {:error, exception}
      {:error, reason} -> {:error, failure("could not start #{title(state)}", reason)}
    end
  end

  defp monitor(state, bus), do: %{state | bus: bus, ref: Process.monitor(bus)}

  defp wire_all(devices, state) do
    Enum.find_value(devices, :ok, fn {place, device} ->
      case call(state, {:wire, place, device, state.robot}) do
        :ok -> nil
        :kept -> log_kept(place, state)
        {:taken, present, robot} -> {:error, conflict(place, present, robot, state)}
        {:raise, exception} -> {:error, exception}
        {:error, reason} -> {:error, failure(no_device(place, state), reason)}
        :bus_ended -> :bus_ended
      end
    end)
  end

  defp call(state, request) do
    GenServer.call(state.bus, request, :infinity)
  catch
    :exit, _reason -> :bus_ended
  end

  defp log_kept(place, state) do
    Logger.debug(
      "#{inspect(state.robot)}: #{title(state)} keeps its own device at #{format_place(place)}"
    )

    nil
  end

  defp conflict(place, {module, _opts}, robot, state) do
    ArgumentError.exception(
      "#{title(state)} has another device at #{format_place(place)}: a #{inspect(module)} " <>
        "that #{inspect(robot)} declares; give #{inspect(state.robot)} another bus or place " <>
        "in its `simulation`, or declare the same device in both"
    )
  end

  defp no_device(place, state),
    do: "could not plug in a device at #{format_place(place)} of #{title(state)}"

  defp failure(sentence, reason), do: RuntimeError.exception("#{sentence}: #{inspect(reason)}")

  defp title(%{kind: :i2c, name: name}), do: "simulated bus #{name}"
  defp title(%{kind: :gpio, name: name}), do: "simulated chip #{name}"

  defp format_place(address) when is_integer(address), do: "0x" <> Integer.to_string(address, 16)
  defp format_place(name), do: inspect(name)
end

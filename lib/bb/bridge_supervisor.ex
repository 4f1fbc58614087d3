defmodule BB.BridgeSupervisor do
  @moduledoc """
  The supervisor of a robot's bridges (`BB.Bridge`). Use its name to find it among the processes
  of a robot.

      BB.Process.whereis(MyRobot, BB.BridgeSupervisor)

  Each bridge is behind a bulkhead (`BB.Process.Bulkhead`), which starts it again whenever it
  ends. Options that a bridge's schema refuses fail the start of the robot, as those of a
  component do; a device that is absent does not.
  """

  use Supervisor

  require Logger

  alias BB.Callback
  alias BB.Component.OptionsSchema
  alias BB.Dsl.{Bridge, Child, Info}
  alias BB.Options.ValidationError
  alias BB.Parameter.Reference
  alias BB.Process.Bulkhead
  alias BB.Robot.SimulationMode
  alias BB.Supervisor.Name

  # A bridge that takes longer fails like a device that is absent.
  @start_ms 5_000

  # The children are bulkheads, which end only when they are killed.
  @restarts [max_restarts: 1_000, max_seconds: 1]

  @doc "Starts the supervisor of a robot's bridges, and the bridges."
  @spec start_link(module()) :: Supervisor.on_start()
  def start_link(robot), do: Supervisor.start_link(__MODULE__, robot)

  @impl Supervisor
  def init(robot) do
    Name.register(robot, __MODULE__)

    robot
    |> bridges(SimulationMode.mode(robot))
    |> Enum.map(fn {name, child} ->
      Bulkhead.child_spec(%{id: name, start: {__MODULE__, :start_bridge, [robot, name, child]}})
    end)
    |> Supervisor.init([strategy: :one_for_one] ++ @restarts)
  end

  defp bridges(robot, mode) do
    for %Bridge{} = bridge <- Info.parameters(robot),
        child = child(bridge, mode),
        do: {bridge.name, child}
  end

  defp child(%{child_spec: child}, nil), do: child
  defp child(%{child_spec: child, simulation: :start}, _mode), do: child
  defp child(%{simulation: :mock}, _mode), do: BB.Sim.Bridge
  defp child(%{simulation: :omit}, _mode), do: nil

  @doc false
  @spec start_bridge(module(), atom(), module() | {module(), keyword()}) :: GenServer.on_start()
  def start_bridge(robot, name, child) do
    {:ok, module, given} = Child.parse(child)

    with {:ok, options} <- options(robot, name, module, given) do
      argument = [bb: %{robot: robot, path: [name]}] ++ options

      module
      |> GenServer.start_link(argument, name: BB.Process.via(robot, name), timeout: @start_ms)
      |> handle_start(robot, name)
    else
      {:error, {:unchecked_options, _text}} = error -> handle_start(error, robot, name)
      {:error, _refused} = error -> error
    end
  rescue
    # The registry is being restarted.
    error in ArgumentError -> handle_start({:error, error}, robot, name)
  end

  defp options(robot, name, module, given) do
    options = Reference.resolve(given, &BB.Parameter.get!(robot, &1))

    with {:error, %ValidationError{} = error} <- check(module, options),
         do: {:error, %{error | keys_path: [name | error.keys_path]}}
  end

  # A module that cannot be loaded fails like a device that is absent: when it starts.
  defp check(module, options) do
    if Code.ensure_loaded?(module) and function_exported?(module, :options_schema, 0),
      do: validate(module, options),
      else: {:ok, options}
  end

  defp validate(module, options) do
    call = {OptionsSchema, :validate, [module, options, []]}
    name = "the check of the options of #{inspect(module)}"

    case Callback.call(call, name: name, remember: false, quiet: true) do
      {:ok, result} -> result
      {:error, failure} -> {:error, {:unchecked_options, Callback.format_failure(failure)}}
    end
  end

  # A first start that failed would fail the robot's. The bulkhead starts the bridge again when
  # this process has ended.
  defp handle_start({:error, reason}, robot, name)
       when not is_tuple(reason) or elem(reason, 0) != :already_started do
    log_failure(robot, name, reason)
    {:ok, spawn_link(fn -> exit({:shutdown, reason}) end)}
  end

  defp handle_start(started, _robot, _name) do
    _ = Process.delete(__MODULE__)
    started
  end

  # The process is the bulkhead, which makes many attempts.
  defp log_failure(robot, name, reason) do
    unless Process.get(__MODULE__) == reason do
      _ = Process.put(__MODULE__, reason)

      Logger.warning(
        "#{inspect(robot)}: bridge #{inspect(name)} did not start, and is started again: " <>
          Exception.format_exit(Callback.showable(reason))
      )
    end
  end
end

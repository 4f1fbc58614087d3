defmodule BB.Safety.Controller do
  @moduledoc """
  The functions of `BB.Safety` under the name that they have in Beam Bots, and those that Beam
  Bots calls when it starts a robot. Use `BB.Safety` in a robot or a driver.

      :ok = BB.Safety.Controller.register_robot(MyRobot)
      :ok = BB.Safety.Controller.arm(MyRobot)
      [] = BB.Safety.Controller.registered_handlers(MyRobot)

  The supervisors of a robot register by themselves.
  """

  alias BB.Safety
  alias BB.Safety.{Records, Wardens}

  @doc "Returns whether the robot is armed, see `BB.Safety.armed?/1`."
  @spec armed?(module()) :: boolean()
  defdelegate armed?(robot), to: Safety

  @doc "Returns whether the robot is in the state `:error`, see `BB.Safety.in_error?/1`."
  @spec in_error?(module()) :: boolean()
  defdelegate in_error?(robot), to: Safety

  @doc "Returns whether the robot is being disarmed, see `BB.Safety.disarming?/1`."
  @spec disarming?(module()) :: boolean()
  defdelegate disarming?(robot), to: Safety

  @doc "Returns the robot's state, see `BB.Safety.state/1`."
  @spec state(module()) :: Safety.state()
  defdelegate state(robot), to: Safety

  @doc "Returns the number of the robot's arming, see `BB.Safety.epoch/1`."
  @spec epoch(module()) :: {:ok, pos_integer()} | :error
  defdelegate epoch(robot), to: Safety

  @doc "Arms the robot. It calls no command, see `BB.Safety.arm/1` for the errors."
  @spec arm(module()) :: :ok | {:error, Safety.arm_error()}
  def arm(robot), do: Wardens.arm(robot)

  @doc "Disarms the robot. It calls no command, see `BB.Safety.disarm/2` for options and errors."
  @spec disarm(module(), timeout: pos_integer()) :: :ok | {:error, term()}
  def disarm(robot, opts \\ []), do: Wardens.disarm(robot, Safety.timeout_ms!(opts))

  @doc "Moves a robot from `:error` to `:disarmed`, see `BB.Safety.force_disarm/1`."
  @spec force_disarm(module()) :: :ok | {:error, :not_in_error | :not_registered}
  defdelegate force_disarm(robot), to: Safety

  @doc "Registers a handler, see `BB.Safety.register/2`."
  @spec register(module(), keyword()) :: :ok
  defdelegate register(module, options), to: Safety

  @doc "Publishes a fault of the hardware, see `BB.Safety.report_error/3`."
  @spec report_error(module(), BB.Path.t(), term()) :: :ok
  defdelegate report_error(robot, path, error), to: Safety

  @doc """
  Makes a robot known, as `:disarmed`. The calling process takes the place of its root supervisor
  until the robot starts.
  """
  @spec register_robot(module()) :: :ok
  def register_robot(robot),
    do: if(Records.known?(robot), do: :ok, else: Wardens.watch(robot, :component))

  @doc """
  Makes the calling process the topology supervisor of a robot. If it dies while the robot is
  armed, the robot is disarmed and its state is `:error`.
  """
  @spec register_topology_supervisor(module()) :: :ok
  def register_topology_supervisor(robot) do
    :ok = register_robot(robot)
    Wardens.watch(robot, :topology)
  end

  @doc "Returns the modules whose `disarm/1` is registered, one for each path."
  @spec registered_handlers(module()) :: [module()]
  def registered_handlers(robot),
    do: for({_key, _owner, module, _opts, _id} <- Records.handlers(robot), do: module)

  @doc """
  Moves an armed robot to `:error`: calls all handlers, and needs `BB.Safety.force_disarm/1`
  however they went. Returns `:ok` also for a robot that is in `:error`.

  For a robot that is `:disarming` it returns the result when that is over. Errors:
  `:already_disarmed`, `:not_registered`.
  """
  @spec transition_to_error(module()) :: :ok | {:error, :already_disarmed | :not_registered}
  def transition_to_error(robot) do
    case Wardens.fail(robot) do
      {:error, reason} when reason in [:already_disarmed, :not_registered] -> {:error, reason}
      _outcome -> if Safety.in_error?(robot), do: :ok, else: {:error, :already_disarmed}
    end
  end
end

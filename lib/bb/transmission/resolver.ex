defmodule BB.Transmission.Resolver do
  @moduledoc """
  Finds the transmission of a sensor or an actuator of a robot, with the present values of the
  parameters to which it refers.

  `BB.Sensor.to_joint_space/3` and `BB.Actuator.to_joint_space/3` use it. A process that keeps a
  transmission for long follows its parameters:

      {transmission, fields} = Resolver.resolve_and_subscribe(R, :actuator, :servo)

      def handle_info({:bb, [:param | path], _changed}, state) do
        %{transmission: transmission, fields: fields} = state
        changed = Resolver.handle_change(R, :actuator, :servo, transmission, fields, path)
        {:noreply, %{state | transmission: changed}}
      end
  """

  alias BB.{Parameter, PubSub, Robot, Transmission}
  alias BB.Parameter.Reference

  @type kind :: :actuator | :sensor

  @typedoc "The fields of a transmission that follow parameters, with the parameters' paths."
  @type fields :: %{atom() => Parameter.path()}

  @doc """
  Returns the transmission of a component, as plain numbers in SI units, or `nil` when it has
  none.

  Raises `BB.Options.ValidationError` when a parameter has a value that a transmission cannot
  have.
  """
  @spec resolve(module(), kind(), atom()) :: Transmission.t() | nil
  def resolve(robot, kind, name) when kind in [:actuator, :sensor],
    do: resolve_declared(robot, declared(robot, kind, name))

  @doc """
  Returns the transmission as `resolve/3` does, and the fields that follow parameters.

  The calling process subscribes to these parameters first, so that no change is lost.
  """
  @spec resolve_and_subscribe(module(), kind(), atom()) :: {Transmission.t() | nil, fields()}
  def resolve_and_subscribe(robot, kind, name) when kind in [:actuator, :sensor] do
    declared = declared(robot, kind, name)

    for path <- Reference.paths(declared),
        do: {:ok, _pubsub} = PubSub.subscribe(robot, [:param | path], [])

    {resolve_declared(robot, declared), fields(declared)}
  end

  @doc """
  Returns the transmission after a change of the parameter at `path`: the same one, unless one of
  its `fields` follows that parameter.
  """
  @spec handle_change(
          module(),
          kind(),
          atom(),
          Transmission.t() | nil,
          fields(),
          Parameter.path()
        ) :: Transmission.t() | nil
  def handle_change(robot, kind, name, transmission, fields, path) do
    if path in Map.values(fields), do: resolve(robot, kind, name), else: transmission
  end

  @doc """
  Returns the joint of a sensor or an actuator, or `nil` when it is on no joint of the robot.
  """
  @spec joint(module(), kind(), atom()) :: atom() | nil
  def joint(robot, kind, name) when kind in [:actuator, :sensor] do
    case fetch(robot, kind, name) do
      %{joint: joint} -> joint
      %{attached_to: {:joint, joint}} -> joint
      _elsewhere -> nil
    end
  end

  defp fields(nil), do: %{}

  defp fields(declared),
    do: for({field, %Reference{path: path}} <- declared, into: %{}, do: {field, path})

  defp resolve_declared(robot, declared) do
    case Transmission.resolve(declared, &Parameter.get!(robot, &1)) do
      {:ok, transmission} -> transmission
      {:error, error} -> raise error
    end
  end

  defp declared(robot, kind, name) do
    with %{transmission: transmission} <- fetch(robot, kind, name), do: transmission
  end

  @places %{sensor: :sensors, actuator: :actuators}

  # A robot that was made by hand has no components, only the places of its sensors and actuators.
  # A driver's test need not have a robot.
  defp fetch(robot, kind, name) do
    if Code.ensure_loaded?(robot) and function_exported?(robot, :robot, 0) do
      declared = robot.robot()

      case Robot.fetch_component(declared, name) do
        {:ok, component} -> component
        :error -> declared |> Map.fetch!(@places[kind]) |> Map.get(name)
      end
    end
  end
end

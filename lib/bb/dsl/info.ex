defmodule BB.Dsl.Info do
  @moduledoc """
  Reads the declaration of a robot as it is written: the entities of each section as structs, with
  their quantities and references. Use it for tools that show or rewrite a declaration;
  `MyRobot.robot()` is the same in SI units.

      BB.Dsl.Info.controllers(MyRobot)
      #=> [%BB.Dsl.Controller{name: :balance, child_spec: {MyRobot.Balance, []}, …}]

      BB.Dsl.Info.settings_name(MyRobot)
      #=> {:ok, :my_robot}
  """

  alias BB.Dsl.{Commands, Compiler}

  @typedoc "A shape of a visual or a collision."
  @type geometry ::
          BB.Dsl.Box.t()
          | BB.Dsl.Cylinder.t()
          | BB.Dsl.Sphere.t()
          | BB.Dsl.Capsule.t()
          | BB.Dsl.Mesh.t()

  @settings [
    registry_module: Registry,
    registry_options: nil,
    supervisor_module: Supervisor,
    parameter_store: nil,
    topology_max_restarts: 3,
    topology_max_seconds: 5
  ]

  @doc false
  @spec declaration(module()) :: Compiler.declaration()
  def declaration(robot), do: robot.__bb_declaration__()

  @doc "Returns the root link, and the joints that stand beside it, if there are any."
  @spec topology(module()) :: [BB.Dsl.Link.t() | BB.Dsl.Joint.t()]
  def topology(robot), do: declaration(robot).topology

  @doc "Returns the sensors of the robot itself."
  @spec sensors(module()) :: [BB.Dsl.Sensor.t()]
  def sensors(robot), do: declaration(robot).sensors

  @doc "Returns the controllers."
  @spec controllers(module()) :: [BB.Dsl.Controller.t()]
  def controllers(robot), do: declaration(robot).controllers

  @doc "Returns the parameters, their groups and the bridges."
  @spec parameters(module()) :: [BB.Dsl.Param.t() | BB.Dsl.ParamGroup.t() | BB.Dsl.Bridge.t()]
  def parameters(robot), do: declaration(robot).parameters

  @doc "Returns the commands and their categories, as declared."
  @spec commands(module()) :: [BB.Dsl.Command.t() | BB.Dsl.Category.t()]
  def commands(robot), do: declaration(robot).commands

  @doc "Returns the settings of the robot, with their defaults."
  @spec settings(module()) :: %{atom() => term()}
  def settings(robot) do
    given = declaration(robot).settings

    for {option, default} <- @settings,
        into: %{},
        do: {option, Map.get_lazy(given, option, fn -> default(option, default) end)}
  end

  # The number of schedulers is the board's, and not the one of the machine that compiles.
  defp default(:registry_options, _default), do: [partitions: System.schedulers_online()]
  defp default(_option, default), do: default

  @doc """
  Returns the name of the robot: `{:ok, name}`, which is the last part of the module's name by
  default, such as `:my_robot` for `MyRobot`.
  """
  @spec settings_name(module()) :: {:ok, atom()}
  def settings_name(robot),
    do: {:ok, Map.get_lazy(declaration(robot).settings, :name, fn -> default_name(robot) end)}

  @doc "Returns the name of the robot."
  @spec settings_name!(module()) :: atom()
  def settings_name!(robot) do
    {:ok, name} = settings_name(robot)
    name
  end

  defp default_name(robot),
    do: robot |> Module.split() |> List.last() |> Macro.underscore() |> String.to_atom()

  for {option, _default} <- @settings do
    @doc "Returns the setting `#{option}`: `{:ok, value}`, or `:error` when it has none."
    @spec unquote(:"settings_#{option}")(module()) :: {:ok, term()} | :error
    def unquote(:"settings_#{option}")(robot) do
      case settings(robot)[unquote(option)] do
        nil -> :error
        value -> {:ok, value}
      end
    end

    @doc "Returns the setting `#{option}`, or raises `ArgumentError` when it has none."
    @spec unquote(:"settings_#{option}!")(module()) :: term()
    def unquote(:"settings_#{option}!")(robot) do
      case unquote(:"settings_#{option}")(robot) do
        {:ok, value} ->
          value

        :error ->
          raise ArgumentError,
                "robot #{inspect(robot)} has no setting #{unquote(option)}; " <>
                  "add it to `settings`"
      end
    end
  end

  @doc "Returns the states in which the robot can be while it is armed, with `:idle`."
  @spec states(module()) :: [BB.Dsl.State.t()]
  def states(robot), do: Commands.states(declaration(robot).states)

  @doc "Returns the names of the `states/1`."
  @spec state_names(module()) :: [atom()]
  def state_names(robot), do: for(state <- states(robot), do: state.name)

  @doc "Returns the state after the robot is armed."
  @spec initial_state(module()) :: atom()
  def initial_state(robot), do: declaration(robot).initial_state

  @doc "Returns the categories of commands, with `:default`."
  @spec categories(module()) :: [BB.Dsl.Category.t()]
  def categories(robot),
    do: Commands.categories(for %BB.Dsl.Category{} = category <- commands(robot), do: category)

  @doc "Returns how many commands of each category may run at the same time."
  @spec category_limits(module()) :: %{atom() => pos_integer()}
  def category_limits(robot),
    do: Map.new(categories(robot), &{&1.name, &1.concurrency_limit})

  @doc "Returns the name of the command that arms the robot, or `nil`."
  @spec arm_command(module()) :: atom() | nil
  def arm_command(robot), do: flagged(robot, :arm)

  @doc "Returns the name of the command that disarms the robot, or `nil`."
  @spec disarm_command(module()) :: atom() | nil
  def disarm_command(robot), do: flagged(robot, :disarm)

  defp flagged(robot, flag) do
    Enum.find_value(commands(robot), fn
      %BB.Dsl.Command{} = command -> if Map.fetch!(command, flag), do: command.name
      _category -> nil
    end)
  end
end

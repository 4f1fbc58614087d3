defmodule BB.Controller.Action do
  @moduledoc """
  What a ready-made controller does when its condition is met: it executes a command of the robot,
  or calls a function.

  `command/1,2` and `handle_event/1` make the actions, and are imported in `controllers`:

      controllers do
        controller :brownout,
                   {BB.Controller.Threshold,
                    topic: [:sensor, :battery],
                    field: :voltage,
                    min: 9.5,
                    action: command(:disarm)}

        controller :bumper,
                   {BB.Controller.PatternMatch,
                    topic: [:sensor, :base, :bumper],
                    match: &MyRobot.Bumper.pressed?/1,
                    action: handle_event(&MyRobot.Bumper.stop/2)}
      end
  """

  alias BB.Message

  defmodule Command do
    @moduledoc """
    An action that executes a command of the robot.

        BB.Controller.Action.command(:disarm)
    """

    @enforce_keys [:command]
    defstruct [:command, args: []]

    @type t :: %__MODULE__{command: atom(), args: keyword()}
  end

  defmodule Callback do
    @moduledoc """
    An action that calls a function with the message and a `BB.Controller.Action.Context`.

        BB.Controller.Action.handle_event(&MyRobot.Bumper.stop/2)
    """

    @enforce_keys [:handler]
    defstruct [:handler]

    @type t :: %__MODULE__{handler: (BB.Message.t(), BB.Controller.Action.Context.t() -> any())}
  end

  defmodule Context do
    @moduledoc """
    The robot of a controller at the moment of an action.

        def stop(_message, %BB.Controller.Action.Context{robot_module: robot}),
          do: BB.Safety.disarm(robot)

      * `:robot_module` - the robot's module
      * `:robot` - its description, a `BB.Robot`
      * `:robot_state` - its state, such as `:disarmed` or `:idle` (`BB.Robot.Runtime.state/1`)
      * `:controller_name` - the name of the controller
    """

    @enforce_keys [:robot_module]
    defstruct [:robot_module, :robot, :robot_state, :controller_name]

    @type t :: %__MODULE__{
            robot_module: module(),
            robot: BB.Robot.t() | nil,
            robot_state: atom(),
            controller_name: atom() | nil
          }
  end

  @type t :: Command.t() | Callback.t()

  @doc """
  Returns the action that executes a command of the robot with arguments.

      iex> BB.Controller.Action.command(:turn, angle: 0.5)
      %BB.Controller.Action.Command{command: :turn, args: [angle: 0.5]}
  """
  @spec command(atom(), keyword()) :: Command.t()
  def command(name, args \\ []) when is_atom(name) and is_list(args),
    do: %Command{command: name, args: args}

  @doc "Returns the action that calls a function with the message and the context."
  @spec handle_event((Message.t(), Context.t() -> any())) :: Callback.t()
  def handle_event(handler) when is_function(handler, 2), do: %Callback{handler: handler}

  @doc """
  Carries out an action, in the calling process.

  A command is a function of the robot's module with one argument, the map of the command's
  arguments. Returns what the function returns.
  """
  @spec execute(t(), Message.t(), Context.t()) :: any()
  def execute(%Command{command: name, args: args}, _message, %Context{robot_module: robot}),
    do: apply(robot, name, [Map.new(args)])

  def execute(%Callback{handler: handler}, message, %Context{} = context),
    do: handler.(message, context)
end

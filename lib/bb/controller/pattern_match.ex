defmodule BB.Controller.PatternMatch do
  @options BB.Options.new!(
             topic: [
               type: {:list, :atom},
               required: true,
               doc: "The path of the messages, with all paths below it."
             ],
             match: [
               type: {:fun, 1},
               required: true,
               doc: "The condition: a function that returns `true` for a `BB.Message`."
             ],
             action: [type: :any, required: true, doc: "A `BB.Controller.Action`."],
             cooldown_ms: [
               type: :non_neg_integer,
               default: 1_000,
               doc: "The shortest time between two actions, in milliseconds."
             ]
           )

  @moduledoc """
  A controller that acts when a message meets a condition.

  Declare it for a reaction that needs no code of its own process:

      controllers do
        controller :bumper,
                   {BB.Controller.PatternMatch,
                    topic: [:sensor, :base, :bumper],
                    match: &MyRobot.Bumper.pressed?/1,
                    action: handle_event(&MyRobot.Bumper.stop/2)}
      end

  The condition and the action run in the controller's process, for one message after the other.
  Within the cooldown after an action the condition is not checked. `BB.Controller.Threshold`
  compares a number of the message instead.

  ## Options

  #{BB.Options.docs(@options)}
  """

  use BB.Controller, options_schema: @options.schema

  alias BB.Controller.Action
  alias BB.{Message, PubSub}

  @default_cooldown_ms 1_000

  @impl BB.Controller
  def init(opts) do
    subscribe(opts)
    {:ok, %{opts: opts, last_triggered: :never}}
  end

  @impl BB.Controller
  def handle_options(opts, state) do
    if opts[:topic] != state.opts[:topic] do
      PubSub.unsubscribe(opts[:bb].robot, state.opts[:topic])
      subscribe(opts)
    end

    {:ok, %{state | opts: opts}}
  end

  defp subscribe(opts) do
    _ = PubSub.subscribe(opts[:bb].robot, opts[:topic], [])
    :ok
  end

  @impl BB.Controller
  def handle_info({:bb, _path, %Message{} = message}, %{opts: opts} = state) do
    now_ms = System.monotonic_time(:millisecond)

    if rested?(state, now_ms) and opts[:match].(message) do
      _ = Action.execute(opts[:action], message, context(opts[:bb]))
      {:noreply, %{state | last_triggered: now_ms}}
    else
      {:noreply, state}
    end
  end

  def handle_info(_message, state), do: {:noreply, state}

  defp rested?(%{last_triggered: :never}, _now_ms), do: true

  defp rested?(%{opts: opts, last_triggered: last_ms}, now_ms),
    do: now_ms - last_ms >= Keyword.get(opts, :cooldown_ms, @default_cooldown_ms)

  defp context(%{robot: robot, path: path}) do
    %Action.Context{
      robot_module: robot,
      robot: robot.robot(),
      robot_state: BB.Robot.Runtime.state(robot),
      controller_name: List.last(path)
    }
  end
end

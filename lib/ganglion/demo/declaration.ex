defmodule Ganglion.Demo.Declaration do
  @moduledoc """
  Reads the declaration of a robot: its name, its ring topics, and the components that use them.

  `Ganglion.Demo` uses it to show any robot, also one without a ring topic.

      iex> Ganglion.Robot |> Ganglion.Demo.Declaration.topics() |> Enum.sort()
      ["camera", "imu", "tags"]
  """

  alias BB.Handoff.Encoding.TagDetections
  alias BB.Handoff.{Inlet, Outlet}
  alias BB.Sensor.NativeProcess

  @doc "Returns the robot's name from its settings, or else the name of its module."
  @spec name(module()) :: String.t()
  def name(robot), do: to_string(robot.robot().settings[:name] || inspect(robot))

  @doc "Returns the ring topics of its components, with its topic prefix (`BB.Topic`)."
  @spec topics(module()) :: [String.t()]
  def topics(robot) do
    for component <- components(robot), name <- declared_topics(component), uniq: true do
      BB.topic(robot, name)
    end
  end

  @doc "Returns the names of its outlets and inlets."
  @spec carriers(module()) :: [atom()]
  def carriers(robot) do
    for %{module: module, name: name} <- components(robot), module in [Inlet, Outlet], do: name
  end

  @doc "Returns the output topic of each component that has one."
  @spec outputs(module()) :: %{atom() => String.t()}
  def outputs(robot) do
    for component <- components(robot), name = output(component), into: %{} do
      {component.name, BB.topic(robot, name)}
    end
  end

  @doc "Tells whether an inlet of the robot receives tag detections."
  @spec vision?(module()) :: boolean()
  def vision?(robot) do
    Enum.any?(components(robot), &(&1.module == Inlet and &1.options[:encoding] == TagDetections))
  end

  defp components(robot), do: robot.robot().components

  defp declared_topics(%{module: module, options: opts}) when module in [Inlet, Outlet],
    do: Enum.filter([opts[:topic]], &is_binary/1)

  defp declared_topics(%{module: NativeProcess, options: opts}),
    do: opts |> literal_topics() |> Keyword.values()

  defp declared_topics(_component), do: []

  # The output of a program with several topics is known only if it declares `publishes:`.
  defp output(%{module: NativeProcess, options: opts} = component) do
    case {opts[:publishes], declared_topics(component)} do
      {[first | _], _topics} when is_binary(first) -> first
      {[first | _], _topics} -> literal_topics(opts)[first]
      {nil, [only]} -> only
      _of_several -> nil
    end
  end

  defp output(component), do: List.first(declared_topics(component))

  # A topic that refers to a parameter is left out.
  defp literal_topics(opts),
    do: for({key, topic} when is_binary(topic) <- opts[:topics] || [], do: {key, topic})
end

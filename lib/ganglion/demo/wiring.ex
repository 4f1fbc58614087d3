defmodule Ganglion.Demo.Wiring do
  @moduledoc """
  What a robot has to do with the ring, as it declares it: which topics there are, and who carries what. Any robot, also one that
  has nothing to do with it.
  """

  alias BB.Handoff.Encoding.TagDetections
  alias BB.Handoff.{Inlet, Outlet}
  alias BB.Sensor.NativeProcess

  @doc "The robot's name, as its settings have it."
  @spec name(module()) :: String.t()
  def name(robot), do: to_string(robot.robot().settings[:name] || inspect(robot))

  @doc "The ring topics that its components name, with its prefix (`BB.Topic`)."
  @spec topics(module()) :: [String.t()]
  def topics(robot) do
    for component <- components(robot), name <- named(component), uniq: true do
      BB.topic(robot, name)
    end
  end

  @doc "Its outlets and inlets, by name."
  @spec carriers(module()) :: [atom()]
  def carriers(robot) do
    for %{module: module, name: name} <- components(robot), module in [Inlet, Outlet], do: name
  end

  @doc "The topic in which a component's output can be seen, for each that has one."
  @spec outputs(module()) :: %{atom() => String.t()}
  def outputs(robot) do
    for component <- components(robot), name = output(component), into: %{} do
      {component.name, BB.topic(robot, name)}
    end
  end

  @doc "Whether detections of tags come in."
  @spec sees?(module()) :: boolean()
  def sees?(robot) do
    Enum.any?(components(robot), &(&1.module == Inlet and &1.options[:encoding] == TagDetections))
  end

  defp components(robot), do: robot.robot().components

  defp named(%{module: module, options: opts}) when module in [Inlet, Outlet],
    do: Enum.filter([opts[:topic]], &is_binary/1)

  defp named(%{module: NativeProcess, options: opts}), do: opts |> used() |> Keyword.values()
  defp named(_component), do: []

  # A program with several topics says which of them it publishes, or it is not known here.
  defp output(%{module: NativeProcess, options: opts} = component) do
    case {opts[:publishes], named(component)} do
      {[first | _], _topics} when is_binary(first) -> first
      {[first | _], _topics} -> used(opts)[first]
      {nil, [only]} -> only
      _of_several -> nil
    end
  end

  defp output(component), do: List.first(named(component))

  # Without what follows a parameter.
  defp used(opts),
    do: for({key, topic} when is_binary(topic) <- opts[:topics] || [], do: {key, topic})
end

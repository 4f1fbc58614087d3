defmodule BB.Component.Pace do
  @moduledoc """
  How often a component publishes on its path, and how often it says that it does.
  """

  alias BB.{Component, Parameter, PubSub}
  alias BB.Component.Resolution

  @typedoc """
  Messages a second as measured over the last sixteen (`nil` before the first) and as declared (`c:BB.Sensor.rate/1`, `nil` where it declares none), and how old the
  last message is, in nanoseconds.
  """
  @type t :: %{
          rate_hz: float() | nil,
          declared_hz: number() | nil,
          age_ns: integer() | nil
        }

  @doc "What was published, for `of/3`."
  @spec heard(module()) :: %{[atom()] => [map()]}
  def heard(robot) do
    Enum.group_by(PubSub.topics(robot), & &1.path)
  rescue
    # The pubsub is being restarted, and has heard nothing.
    ArgumentError -> %{}
  end

  @doc "The pace of a component. Several types of messages on its path count together."
  @spec of(module(), Component.t(), %{[atom()] => [map()]}) :: t()
  def of(robot, component, heard) do
    heard
    |> Map.get(Component.data_path(component), [])
    |> measured()
    |> Map.put(:declared_hz, declared_hz(robot, component))
  end

  defp measured([]), do: %{rate_hz: nil, age_ns: nil}

  defp measured(topics) do
    %{
      rate_hz: topics |> Enum.map(& &1.rate_hz) |> Enum.sum(),
      age_ns: topics |> Enum.map(& &1.age_ns) |> Enum.min()
    }
  end

  # As its options are now, with what the parameters are.
  defp declared_hz(robot, %{module: module} = component) do
    if Code.ensure_loaded?(module) and function_exported?(module, :rate, 1) do
      resolution = Resolution.of(robot, component)
      values = Map.new(Resolution.paths(resolution), &{&1, Parameter.get!(robot, &1)})

      with {:ok, options} <- Resolution.options(resolution, values),
           do: module.rate(options),
           else: (_refused -> nil)
    end
  rescue
    # The parameters are being restarted.
    ArgumentError -> nil
  end
end

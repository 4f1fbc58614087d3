defmodule BB.Component.PublishRate do
  @moduledoc """
  How often components publish on their paths, as measured and as declared.

  `BB.Component.Health` adds these numbers to the rows of `health/1`.
  """
  @moduledoc no_example: "internal: BB.Sensor.health/1 shows the rates"

  alias BB.{Component, PubSub}
  alias BB.Component.DeclaredRate

  @typedoc """
  The rates of one component:

    * `rate_hz` - messages a second, measured over the last sixteen; `nil` before the first
    * `declared_hz` - messages a second as the module declares (`c:BB.Sensor.rate/1`), or `nil`
    * `age_ns` - the age of the last message in nanoseconds; `nil` before the first
  """
  @type t :: %{
          rate_hz: float() | nil,
          declared_hz: number() | nil,
          age_ns: integer() | nil
        }

  @doc """
  Returns the rates of the given components of a robot, in their order.

  Messages of several types on one path count together.
  """
  @spec list(module(), [Component.t()]) :: [t()]
  def list(robot, components) do
    topics = topics_by_path(robot)

    for {component, declared_hz} <- Enum.zip(components, DeclaredRate.list(robot, components)) do
      topics
      |> Map.get(Component.data_path(component), [])
      |> measure()
      |> Map.put(:declared_hz, declared_hz)
    end
  end

  defp topics_by_path(robot) do
    Enum.group_by(PubSub.topics(robot), & &1.path)
  rescue
    # The pubsub is being restarted, and has counted nothing.
    ArgumentError -> %{}
  end

  defp measure([]), do: %{rate_hz: nil, age_ns: nil}

  defp measure(topics) do
    %{
      rate_hz: topics |> Enum.map(& &1.rate_hz) |> Enum.sum(),
      age_ns: topics |> Enum.map(& &1.age_ns) |> Enum.min()
    }
  end
end

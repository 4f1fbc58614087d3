defmodule BB.Component.PublishRate do
  @moduledoc """
  How often components publish on their paths, and how often they say that they do.
  """

  alias BB.{Component, PubSub}
  alias BB.Component.DeclaredRate

  @typedoc """
  Messages a second as measured over the last sixteen (`nil` before the first) and as declared
  (`c:BB.Sensor.rate/1`, `nil` where it declares none), and how old the last message is, in
  nanoseconds.
  """
  @type t :: %{
          rate_hz: float() | nil,
          declared_hz: number() | nil,
          age_ns: integer() | nil
        }

  @doc """
  The paces of components of a robot, in their order. Several types of messages on a path count
  together.
  """
  @spec of(module(), [Component.t()]) :: [t()]
  def of(robot, components) do
    heard = heard(robot)

    for {component, declared_hz} <- Enum.zip(components, DeclaredRate.rates(robot, components)) do
      heard
      |> Map.get(Component.data_path(component), [])
      |> measured()
      |> Map.put(:declared_hz, declared_hz)
    end
  end

  defp heard(robot) do
    Enum.group_by(PubSub.topics(robot), & &1.path)
  rescue
    # The pubsub is being restarted, and has heard nothing.
    ArgumentError -> %{}
  end

  defp measured([]), do: %{rate_hz: nil, age_ns: nil}

  defp measured(topics) do
    %{
      rate_hz: topics |> Enum.map(& &1.rate_hz) |> Enum.sum(),
      age_ns: topics |> Enum.map(& &1.age_ns) |> Enum.min()
    }
  end
end

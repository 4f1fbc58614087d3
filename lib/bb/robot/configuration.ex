defmodule BB.Robot.Configuration do
  @moduledoc """
  The shapes of a joint's configuration and velocity. Pure. `BB.Robot.State` and
  `BB.Robot.Kinematics` use it.

      iex> joint = %BB.Robot.Joint{name: :j, type: :revolute, parent_link: :a, child_link: :b}
      iex> BB.Robot.Configuration.check(joint, :configuration, 1)
      {:ok, 1.0}
      iex> {:error, error} = BB.Robot.Configuration.check(joint, :configuration, "1")
      iex> Exception.message(error)
      ~s(joint :j, field :configuration: expected a number, got: "1")
  """

  alias BB.Error.Invalid.JointConfig
  alias BB.Math.{Transform, Transform2D, Vec3}
  alias BB.Message.Geometry.{Twist, Twist2D}
  alias BB.Robot.Joint

  @typedoc "Rad or m, or a pose of a planar or floating joint."
  @type t :: float() | Transform2D.t() | Transform.t()

  @typedoc "Rad/s or m/s, or a twist of a planar or floating joint."
  @type velocity :: float() | Twist2D.t() | Twist.t()

  @type field :: :configuration | :velocity

  @doc "Returns the configuration or velocity that a joint has at first."
  @spec first(Joint.t(), field()) :: t() | velocity()
  def first(%Joint{type: :planar}, :configuration), do: Transform2D.identity()
  def first(%Joint{type: :floating}, :configuration), do: Transform.identity()
  def first(%Joint{type: :planar}, :velocity), do: %Twist2D{vx: 0.0, vy: 0.0, omega: 0.0}

  def first(%Joint{type: :floating}, :velocity),
    do: %Twist{linear: Vec3.zero(), angular: Vec3.zero()}

  def first(%Joint{}, _field), do: 0.0

  @doc """
  Checks the configuration or velocity of a joint: `{:ok, value}`, with an integer as a float, or
  an error.
  """
  @spec check(Joint.t(), field(), term()) :: {:ok, t() | velocity()} | {:error, Exception.t()}
  def check(%Joint{type: :fixed}, _field, value) when is_number(value) and value == 0,
    do: {:ok, 0.0}

  def check(%Joint{type: :planar}, :configuration, %Transform2D{} = value), do: {:ok, value}
  def check(%Joint{type: :floating}, :configuration, %Transform{} = value), do: {:ok, value}
  def check(%Joint{type: :planar}, :velocity, %Twist2D{} = value), do: {:ok, value}
  def check(%Joint{type: :floating}, :velocity, %Twist{} = value), do: {:ok, value}

  def check(%Joint{type: type}, _field, value)
      when is_number(value) and type in [:revolute, :continuous, :prismatic],
      do: {:ok, value / 1}

  def check(%Joint{} = joint, field, value) do
    expected = expected(joint.type, field)

    {:error, %JointConfig{joint: joint.name, field: field, value: value, expected: expected}}
  end

  defp expected(:fixed, _field), do: "0, because the joint is fixed"
  defp expected(:planar, :configuration), do: "a BB.Math.Transform2D"
  defp expected(:floating, :configuration), do: "a BB.Math.Transform"
  defp expected(:planar, :velocity), do: "a BB.Message.Geometry.Twist2D"
  defp expected(:floating, :velocity), do: "a BB.Message.Geometry.Twist"
  defp expected(_type, _field), do: "a number"
end

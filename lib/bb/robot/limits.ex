defmodule BB.Robot.Limits do
  @moduledoc """
  Reads the limits of a joint, which may follow parameters. Pure.

  `BB.Component.Resolution` uses it for the profile of a motor.

      iex> import BB.Parameter.Reference
      iex> declared = %{lower: -1.0, upper: param([:reach])}
      iex> BB.Robot.Limits.resolve(declared, fn [:reach] -> BB.Unit.new!(90, :degree) end)
      %{lower: -1.0, upper: 1.5707963267948966, velocity: nil, effort: nil, acceleration: nil}
  """

  alias BB.Parameter.Reference
  alias BB.Unit

  @fields [:lower, :upper, :velocity, :effort, :acceleration]
  @none Map.new(@fields, &{&1, nil})

  @typedoc "The limits in SI units; `nil` for one that the joint does not have."
  @type t :: %{
          lower: float() | nil,
          upper: float() | nil,
          velocity: float() | nil,
          effort: float() | nil,
          acceleration: float() | nil
        }

  @typedoc "The limits as declared, which may refer to parameters."
  @type declared :: %{optional(atom()) => float() | Unit.t() | Reference.t() | nil}

  @doc "Returns the declared limits of a joint, or `nil` when the robot declares none."
  @spec declared(BB.Robot.t(), atom()) :: declared() | nil
  def declared(robot, joint_name) do
    case Map.get(robot.joints, joint_name) do
      %{limits: %{} = limits} -> put_references(limits, robot, joint_name)
      _joint_without_limits -> nil
    end
  end

  # A field that follows a parameter is nil in the robot, which lists the parameter apart.
  defp put_references(limits, robot, joint_name) do
    for {path, places} <- robot.param_subscriptions,
        {:joint, ^joint_name, [:limits, field]} <- places,
        into: limits,
        do: {field, %Reference{path: path}}
  end

  @doc "Returns the limits in SI units, with the values of the parameters to which they refer."
  @spec resolve(declared() | nil, (BB.Parameter.path() -> term())) :: t() | nil
  def resolve(nil, _value), do: nil

  def resolve(declared, value) do
    for {field, limit} <- Reference.resolve(declared, value),
        field in @fields,
        into: @none,
        do: {field, to_si(limit)}
  end

  defp to_si(nil), do: nil
  defp to_si(%Unit{} = quantity), do: Unit.to_si(quantity)
  defp to_si(number) when is_number(number), do: number / 1
end

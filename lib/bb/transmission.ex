defmodule BB.Transmission do
  @moduledoc """
  What is between a joint and the motor or encoder at it: gears, an offset, a direction. Pure.

      sensor :encoder, {BB.Sensor.As5600, bus: "i2c-1"} do
        transmission do
          reduction 50.0
          offset ~u(5 degree)
          reversed? true
        end
      end

    * `:reduction` - motor turns per joint turn, above zero (`1.0`)
    * `:offset` - where the joint is when the motor is at zero; rad, or m of a prismatic joint (`0.0`)
    * `:reversed?` - whether the motor turns the other way (`false`)

  With s = -1 when reversed, else 1, and r the reduction:

  | | motor | joint |
  |---|---|---|
  | position | s · r · (joint − offset) | s · motor / r + offset |
  | rate: speed, acceleration | s · r · joint | s · motor / r |
  | effort | s · joint / r | s · r · motor |

  "motor" stands for the sensor's side as well. `apply_*` goes from joint to motor, `unapply_*` back. `nil` is no transmission, and
  changes nothing.
  """

  alias BB.Message
  alias BB.Message.Actuator.BeginMotion
  alias BB.Message.Actuator.Command.{Effort, Position, Trajectory, Velocity}
  alias BB.Message.Sensor.JointState
  alias BB.Options.ValidationError
  alias BB.Parameter.Reference
  alias BB.Unit

  @type t :: %{reduction: float(), offset: float(), reversed?: boolean()}

  @typedoc "As a robot's module has it: fields that follow a parameter are references."
  @type declared :: %{
          reduction: float() | Reference.t(),
          offset: float() | Reference.t(),
          reversed?: boolean() | Reference.t()
        }

  @default %{reduction: 1.0, offset: 0.0, reversed?: false}

  @doc """
  A transmission of the fields given, with plain numbers in SI units.

      iex> import BB.Unit
      iex> BB.Transmission.new(reduction: 2, offset: ~u(1 centimeter))
      %{reduction: 2.0, offset: 0.01, reversed?: false}
  """
  @spec new(Enumerable.t()) :: declared()
  def new(fields),
    do: Enum.reduce(fields, @default, fn {key, value}, t -> %{t | key => plain(value)} end)

  defp plain(%Unit{} = quantity), do: Unit.to_si(quantity)
  defp plain(number) when is_number(number), do: number / 1
  defp plain(other), do: other

  @doc """
  A declared transmission with values in the place of its references, looked up by `value`: `{:ok, transmission}`, or the error when a
  value is not what a transmission can have.

      iex> import BB.Parameter.Reference
      iex> declared = BB.Transmission.new(reduction: param([:gear]))
      iex> BB.Transmission.resolve(declared, fn [:gear] -> 3.0 end)
      {:ok, %{reduction: 3.0, offset: 0.0, reversed?: false}}
      iex> {:error, error} = BB.Transmission.resolve(declared, fn [:gear] -> 0.0 end)
      iex> Exception.message(error)
      "invalid value for :reduction option: expected a number above zero, got: 0.0 (in options [:transmission])"
  """
  @spec resolve(declared() | nil, (BB.Parameter.path() -> term())) ::
          {:ok, t() | nil} | {:error, ValidationError.t()}
  def resolve(nil, _value), do: {:ok, nil}
  def resolve(declared, value), do: declared |> Reference.resolve(value) |> new() |> check()

  defp check(%{reduction: r}) when not is_float(r) or r <= 0.0,
    do: refuse(:reduction, r, "a number above zero")

  defp check(%{offset: offset}) when not is_float(offset),
    do: refuse(:offset, offset, "an angle or a length")

  defp check(%{reversed?: reversed?}) when not is_boolean(reversed?),
    do: refuse(:reversed?, reversed?, "boolean")

  defp check(transmission), do: {:ok, transmission}

  defp refuse(key, value, expected) do
    message =
      "invalid value for #{inspect(key)} option: expected #{expected}, got: #{inspect(value)}"

    {:error,
     %ValidationError{key: key, value: value, message: message, keys_path: [:transmission]}}
  end

  # One number

  @doc """
  A joint's position as the motor's.

      iex> BB.Transmission.apply_position(1.5, %{reduction: 10.0, offset: 0.5, reversed?: true})
      -10.0
  """
  @spec apply_position(float(), t() | nil) :: float()
  def apply_position(joint, nil), do: joint
  def apply_position(joint, t), do: sign(t) * t.reduction * (joint - t.offset)

  @doc """
  A motor's position as the joint's.

      iex> BB.Transmission.unapply_position(-10.0, %{reduction: 10.0, offset: 0.5, reversed?: true})
      1.5
  """
  @spec unapply_position(float(), t() | nil) :: float()
  def unapply_position(motor, nil), do: motor
  def unapply_position(motor, t), do: sign(t) * motor / t.reduction + t.offset

  @doc """
  A joint's speed or acceleration as the motor's.

      iex> BB.Transmission.apply_rate(2.0, %{reduction: 10.0, offset: 0.5, reversed?: false})
      20.0
  """
  @spec apply_rate(float(), t() | nil) :: float()
  def apply_rate(joint, nil), do: joint
  def apply_rate(joint, t), do: sign(t) * t.reduction * joint

  @doc "A motor's speed or acceleration as the joint's."
  @spec unapply_rate(float(), t() | nil) :: float()
  def unapply_rate(motor, nil), do: motor
  def unapply_rate(motor, t), do: sign(t) * motor / t.reduction

  @doc """
  A joint's torque or force as the motor's.

      iex> BB.Transmission.apply_effort(2.0, %{reduction: 10.0, offset: 0.5, reversed?: true})
      -0.2
  """
  @spec apply_effort(float(), t() | nil) :: float()
  def apply_effort(joint, nil), do: joint
  def apply_effort(joint, t), do: sign(t) * joint / t.reduction

  @doc "A motor's torque or force as the joint's."
  @spec unapply_effort(float(), t() | nil) :: float()
  def unapply_effort(motor, nil), do: motor
  def unapply_effort(motor, t), do: sign(t) * t.reduction * motor

  # Messages

  @doc """
  A command in joint space as the motor's: a message, or its payload alone. Commands without numbers of the joint's are not changed,
  nor is anything that is no command.
  """
  @spec apply_to_command(message, t() | nil) :: message when message: Message.t() | struct()
  def apply_to_command(message, nil), do: message

  def apply_to_command(%Message{payload: payload} = message, t),
    do: %{message | payload: apply_to_command(payload, t)}

  def apply_to_command(%{__struct__: type} = payload, t)
      when type in [Position, Velocity, Effort],
      do: commanded(payload, t)

  def apply_to_command(%{__struct__: Trajectory, waypoints: waypoints} = payload, t),
    do: %{payload | waypoints: Enum.map(waypoints, &commanded(&1, t))}

  def apply_to_command(payload, _t), do: payload

  @doc """
  What a motor's side reports, in joint space: a message, or its payload alone. Joint states point by point, the rates of a
  `BeginMotion` as magnitudes; others are not changed, nor are values of joints that move in the plane or freely.
  """
  @spec unapply_to_payload(message, t() | nil) :: message when message: Message.t() | struct()
  def unapply_to_payload(message, nil), do: message

  def unapply_to_payload(%Message{payload: payload} = message, t),
    do: %{message | payload: unapply_to_payload(payload, t)}

  def unapply_to_payload(%JointState{} = state, t) do
    %{
      state
      | positions: numbers(state.positions, t, &unapply_position/2),
        velocities: numbers(state.velocities, t, &unapply_rate/2),
        efforts: numbers(state.efforts, t, &unapply_effort/2)
    }
  end

  def unapply_to_payload(%{__struct__: BeginMotion} = motion, t) do
    motion
    |> change([:initial_position, :target_position], &unapply_position(&1, t))
    |> change([:peak_velocity, :acceleration], &abs(unapply_rate(&1, t)))
  end

  def unapply_to_payload(payload, _t), do: payload

  defp commanded(fields, t) when is_list(fields),
    do: for({key, value} <- fields, do: {key, command(key, value, t)})

  defp commanded(%{} = payload, t) do
    Enum.reduce([:position, :velocity, :effort], payload, fn key, payload ->
      case payload do
        %{^key => value} -> %{payload | key => command(key, value, t)}
        _ -> payload
      end
    end)
  end

  defp command(:position, value, t) when is_number(value), do: apply_position(value, t)

  defp command(key, value, t) when key in [:velocity, :acceleration] and is_number(value),
    do: apply_rate(value, t)

  defp command(:effort, value, t) when is_number(value), do: apply_effort(value, t)
  defp command(_key, value, _t), do: value

  defp change(fields, keys, change) do
    Enum.reduce(keys, fields, fn key, fields ->
      case fields do
        %{^key => value} when is_number(value) -> %{fields | key => change.(value)}
        _ -> fields
      end
    end)
  end

  defp numbers(values, t, change),
    do: for(value <- values, do: if(is_number(value), do: change.(value, t), else: value))

  defp sign(%{reversed?: true}), do: -1.0
  defp sign(_t), do: 1.0
end

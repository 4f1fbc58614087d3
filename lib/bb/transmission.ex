defmodule BB.Transmission do
  @moduledoc """
  The transmission between a joint and its motor or encoder: a reduction, an offset and a
  direction.

  Declare it in a sensor or an actuator, and convert numbers or whole messages by the functions of
  this module. The module is pure.

      sensor :encoder, {BB.Sensor.As5600, bus: "i2c-1"} do
        transmission do
          reduction 50.0
          offset ~u(5 degree)
          reversed? true
        end
      end

    * `:reduction` - the turns of the motor for one turn of the joint, not zero (`1.0`); a
      negative one turns the other way
    * `:offset` - the position of the joint when the motor is at zero, in rad, or in m for a
      prismatic joint (`0.0`)
    * `:reversed?` - whether the motor turns in the other direction (`false`)

  With s = -1 when reversed, else 1, and r the reduction:

  | | motor | joint |
  |---|---|---|
  | position | s · r · (joint − offset) | s · motor / r + offset |
  | rate: speed, acceleration | s · r · joint | s · motor / r |
  | effort | s · joint / r | s · r · motor |

  "motor" includes the sensor's side. `apply_*` converts from joint to motor, `unapply_*` back.
  `nil` is no transmission, and changes nothing.
  """

  alias BB.Message
  alias BB.Message.Actuator.BeginMotion
  alias BB.Message.Actuator.Command.{Effort, Position, Trajectory, Velocity}
  alias BB.Message.Sensor.JointState
  alias BB.Options.ValidationError
  alias BB.Parameter.Reference
  alias BB.Unit

  @type t :: %{reduction: float(), offset: float(), reversed?: boolean()}

  @typedoc "A transmission as declared, whose fields may be references to parameters."
  @type declared :: %{
          reduction: float() | Reference.t(),
          offset: float() | Reference.t(),
          reversed?: boolean() | Reference.t()
        }

  @default %{reduction: 1.0, offset: 0.0, reversed?: false}

  @doc """
  Returns a transmission with the given fields, as plain numbers in SI units.

      iex> import BB.Unit
      iex> BB.Transmission.new(reduction: 2, offset: ~u(1 centimeter))
      %{reduction: 2.0, offset: 0.01, reversed?: false}
  """
  @spec new(Enumerable.t()) :: declared()
  def new(fields),
    do: Enum.reduce(fields, @default, fn {key, value}, t -> %{t | key => to_si(value)} end)

  defp to_si(%Unit{} = quantity), do: Unit.to_si(quantity)
  defp to_si(number) when is_number(number), do: number / 1
  defp to_si(other), do: other

  @doc """
  Replaces the references of a declared transmission by their values.

  `value` returns the value of a parameter's path. A value that a transmission cannot have is an
  error.

      iex> import BB.Parameter.Reference
      iex> declared = BB.Transmission.new(reduction: param([:gear]))
      iex> BB.Transmission.resolve(declared, fn [:gear] -> 3.0 end)
      {:ok, %{reduction: 3.0, offset: 0.0, reversed?: false}}
      iex> {:error, error} = BB.Transmission.resolve(declared, fn [:gear] -> 0.0 end)
      iex> Exception.message(error)
      "invalid value for :reduction option: expected a number other than zero, got: 0.0 " <>
        "(in options [:transmission])"
  """
  @spec resolve(declared() | nil, (BB.Parameter.path() -> term())) ::
          {:ok, t() | nil} | {:error, ValidationError.t()}
  def resolve(nil, _value), do: {:ok, nil}
  def resolve(declared, value), do: declared |> Reference.resolve(value) |> new() |> check()

  defp check(%{reduction: r}) when not is_float(r) or r == 0.0,
    do: refuse(:reduction, r, "a number other than zero")

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
  Converts a joint's position to the motor's.

      iex> BB.Transmission.apply_position(1.5, %{reduction: 10.0, offset: 0.5, reversed?: true})
      -10.0
  """
  @spec apply_position(float(), t() | nil) :: float()
  def apply_position(joint, nil), do: joint
  def apply_position(joint, t), do: sign(t) * t.reduction * (joint - t.offset)

  @doc """
  Converts a motor's position to the joint's.

      iex> transmission = %{reduction: 10.0, offset: 0.5, reversed?: true}
      iex> BB.Transmission.unapply_position(-10.0, transmission)
      1.5
  """
  @spec unapply_position(float(), t() | nil) :: float()
  def unapply_position(motor, nil), do: motor
  def unapply_position(motor, t), do: sign(t) * motor / t.reduction + t.offset

  @doc """
  Converts a joint's speed or acceleration to the motor's.

      iex> BB.Transmission.apply_rate(2.0, %{reduction: 10.0, offset: 0.5, reversed?: false})
      20.0
  """
  @spec apply_rate(float(), t() | nil) :: float()
  def apply_rate(joint, nil), do: joint
  def apply_rate(joint, t), do: sign(t) * t.reduction * joint

  @doc "Converts a motor's speed or acceleration to the joint's."
  @spec unapply_rate(float(), t() | nil) :: float()
  def unapply_rate(motor, nil), do: motor
  def unapply_rate(motor, t), do: sign(t) * motor / t.reduction

  @doc """
  Converts a joint's torque or force to the motor's.

      iex> BB.Transmission.apply_effort(2.0, %{reduction: 10.0, offset: 0.5, reversed?: true})
      -0.2
  """
  @spec apply_effort(float(), t() | nil) :: float()
  def apply_effort(joint, nil), do: joint
  def apply_effort(joint, t), do: sign(t) * joint / t.reduction

  @doc "Converts a motor's torque or force to the joint's."
  @spec unapply_effort(float(), t() | nil) :: float()
  def unapply_effort(motor, nil), do: motor
  def unapply_effort(motor, t), do: sign(t) * t.reduction * motor

  # Messages

  @doc """
  Converts a command from joint space to the motor's: a message, or its payload alone.

  A command without numbers of the joint, and a payload that is no command, do not change.
  """
  @spec apply_to_command(message, t() | nil) :: message when message: Message.t() | struct()
  def apply_to_command(message, nil), do: message

  def apply_to_command(%Message{payload: payload} = message, t),
    do: %{message | payload: apply_to_command(payload, t)}

  def apply_to_command(%{__struct__: type} = payload, t)
      when type in [Position, Velocity, Effort],
      do: convert_command(payload, t)

  def apply_to_command(%{__struct__: Trajectory, waypoints: waypoints} = payload, t),
    do: %{payload | waypoints: Enum.map(waypoints, &convert_command(&1, t))}

  def apply_to_command(payload, _t), do: payload

  @doc """
  Converts a report from the motor's side into joint space: a message, or its payload alone.

  It converts the values of a `JointState` one by one, and the rates of a `BeginMotion` as
  magnitudes. Other payloads do not change, nor do values of planar and floating joints.
  """
  @spec unapply_to_payload(message, t() | nil) :: message when message: Message.t() | struct()
  def unapply_to_payload(message, nil), do: message

  def unapply_to_payload(%Message{payload: payload} = message, t),
    do: %{message | payload: unapply_to_payload(payload, t)}

  def unapply_to_payload(%JointState{} = state, t) do
    %{
      state
      | positions: map_numbers(state.positions, t, &unapply_position/2),
        velocities: map_numbers(state.velocities, t, &unapply_rate/2),
        efforts: map_numbers(state.efforts, t, &unapply_effort/2)
    }
  end

  def unapply_to_payload(%{__struct__: BeginMotion} = motion, t) do
    motion
    |> update_numbers([:initial_position, :target_position], &unapply_position(&1, t))
    |> update_numbers([:peak_velocity, :acceleration], &abs(unapply_rate(&1, t)))
  end

  def unapply_to_payload(payload, _t), do: payload

  defp convert_command(fields, t) when is_list(fields),
    do: for({key, value} <- fields, do: {key, convert_value(key, value, t)})

  defp convert_command(%{} = payload, t) do
    Enum.reduce([:position, :velocity, :effort], payload, fn key, payload ->
      case payload do
        %{^key => value} -> %{payload | key => convert_value(key, value, t)}
        _ -> payload
      end
    end)
  end

  defp convert_value(:position, value, t) when is_number(value), do: apply_position(value, t)

  defp convert_value(key, value, t) when key in [:velocity, :acceleration] and is_number(value),
    do: apply_rate(value, t)

  defp convert_value(:effort, value, t) when is_number(value), do: apply_effort(value, t)
  defp convert_value(_key, value, _t), do: value

  defp update_numbers(fields, keys, fun) do
    Enum.reduce(keys, fields, fn key, fields ->
      case fields do
        %{^key => value} when is_number(value) -> %{fields | key => fun.(value)}
        _ -> fields
      end
    end)
  end

  defp map_numbers(values, t, fun),
    do: for(value <- values, do: if(is_number(value), do: fun.(value, t), else: value))

  defp sign(%{reversed?: true}), do: -1.0
  defp sign(_t), do: 1.0
end

defmodule BB.Message.Geometry.Twist2D do
  @moduledoc """
  The velocity of a body in the plane.

  Use it for joints and bodies that move in a plane, for example in
  `BB.Message.Sensor.JointState`:

      iex> {:ok, message} = BB.Message.Geometry.Twist2D.new(:base_link, 0.5, 0, 0.1)
      iex> message.payload.omega
      0.1
  """

  defstruct [:vx, :vy, :omega]

  @type t :: %__MODULE__{vx: float(), vy: float(), omega: float()}

  use BB.Message,
    schema: [
      vx: [type: :float, required: true, doc: "The velocity along x, in m/s."],
      vy: [type: :float, required: true, doc: "The velocity along y, in m/s."],
      omega: [
        type: :float,
        required: true,
        doc: "The angular velocity, counter-clockwise, in rad/s."
      ]
    ]

  @doc """
  Creates a message from three numbers, which become floats. Returns `{:ok, message}`.

  The attributes of `new/2` have to be floats.
  """
  @spec new(atom(), number(), number(), number()) ::
          {:ok, BB.Message.t(t())} | {:error, BB.Options.ValidationError.t()}
  def new(frame_id, vx, vy, omega)
      when is_number(vx) and is_number(vy) and is_number(omega),
      do: new(frame_id, vx: vx / 1, vy: vy / 1, omega: omega / 1)
end

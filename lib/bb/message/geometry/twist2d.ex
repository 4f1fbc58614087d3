defmodule BB.Message.Geometry.Twist2D do
  @moduledoc """
  The velocity of a body in the plane.

  Use it for joints and bodies that move in a plane, for example in
  `BB.Message.Sensor.JointState`:

      iex> {:ok, message} = BB.Message.Geometry.Twist2D.new(:base_link, 0.5, 0.0, 0.1)
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

  @doc "Creates a message from the three floats. Returns `{:ok, message}`."
  @spec new(atom(), float(), float(), float()) ::
          {:ok, BB.Message.t(t())} | {:error, BB.Options.ValidationError.t()}
  def new(frame_id, vx, vy, omega), do: new(frame_id, vx: vx, vy: vy, omega: omega)
end

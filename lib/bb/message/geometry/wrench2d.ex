defmodule BB.Message.Geometry.Wrench2D do
  @moduledoc """
  The force and torque on a body in the plane.

  Use it for joints and bodies that move in a plane, for example in
  `BB.Message.Sensor.JointState`:

      iex> {:ok, message} = BB.Message.Geometry.Wrench2D.new(:base_link, 2, 0, 0.1)
      iex> message.payload.tau
      0.1
  """

  defstruct [:fx, :fy, :tau]

  @type t :: %__MODULE__{fx: float(), fy: float(), tau: float()}

  use BB.Message,
    schema: [
      fx: [type: :float, required: true, doc: "The force along x, in N."],
      fy: [type: :float, required: true, doc: "The force along y, in N."],
      tau: [type: :float, required: true, doc: "The torque, counter-clockwise, in N·m."]
    ]

  @doc """
  Creates a message from three numbers, which become floats. Returns `{:ok, message}`.

  The attributes of `new/2` have to be floats.
  """
  @spec new(atom(), number(), number(), number()) ::
          {:ok, BB.Message.t(t())} | {:error, BB.Options.ValidationError.t()}
  def new(frame_id, fx, fy, tau)
      when is_number(fx) and is_number(fy) and is_number(tau),
      do: new(frame_id, fx: fx / 1, fy: fy / 1, tau: tau / 1)
end

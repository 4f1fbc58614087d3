defmodule BB.Message.Sensor.JointState do
  @moduledoc """
  The positions, velocities and efforts of joints.

  Encoders and actuators that measure their joints publish it:

      iex> {:ok, message} = BB.Message.Sensor.JointState.new(:arm,
      ...>   names: [:shoulder, :elbow], positions: [0.5, 1.2])
      iex> message.payload.velocities
      []

  The lists are in the order of `names`; an empty list is unknown. The values are floats, in rad,
  rad/s and N·m for a revolute joint, and in m, m/s and N for a prismatic one. A joint that moves
  in the plane or freely has the structs of `BB.Math` and `BB.Message.Geometry` instead.
  """

  alias BB.Math.{Transform, Transform2D}
  alias BB.Message.Geometry.{Twist, Twist2D, Wrench, Wrench2D}
  alias BB.Message.Option

  defstruct [:names, positions: [], velocities: [], efforts: []]

  @type t :: %__MODULE__{
          names: [atom()],
          positions: [float() | Transform2D.t() | Transform.t()],
          velocities: [float() | Twist2D.t() | Twist.t()],
          efforts: [float() | Wrench2D.t() | Wrench.t()]
        }

  use BB.Message,
    schema: [
      names: [
        type: {:custom, __MODULE__, :check_names, []},
        required: true,
        type_doc: "list of `t:atom/0`",
        doc: "The names of the joints."
      ],
      positions: [
        type: Option.configurations_type(),
        default: [],
        doc: "Floats in rad or m, `BB.Math.Transform2D` or `BB.Math.Transform`."
      ],
      velocities: [
        type: Option.velocities_type(),
        default: [],
        doc:
          "Floats in rad/s or m/s, `BB.Message.Geometry.Twist2D` or `BB.Message.Geometry.Twist`."
      ],
      efforts: [
        type: Option.efforts_type(),
        default: [],
        doc: "Floats in N·m or N, `BB.Message.Geometry.Wrench2D` or `BB.Message.Geometry.Wrench`."
      ]
    ]

  @doc false
  def check_names(names), do: Option.check_elements(names, &is_atom/1, "an atom")
end

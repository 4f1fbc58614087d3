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
        type: {:custom, __MODULE__, :check_values, [[Transform2D, Transform]]},
        default: [],
        doc: "Floats in rad or m, `BB.Math.Transform2D` or `BB.Math.Transform`."
      ],
      velocities: [
        type: {:custom, __MODULE__, :check_values, [[Twist2D, Twist]]},
        default: [],
        doc:
          "Floats in rad/s or m/s, `BB.Message.Geometry.Twist2D` or `BB.Message.Geometry.Twist`."
      ],
      efforts: [
        type: {:custom, __MODULE__, :check_values, [[Wrench2D, Wrench]]},
        default: [],
        doc: "Floats in N·m or N, `BB.Message.Geometry.Wrench2D` or `BB.Message.Geometry.Wrench`."
      ]
    ]

  @doc false
  def check_names(names), do: check_elements(names, &is_atom/1, fn -> "an atom" end)

  @doc false
  def check_values(values, structs) do
    valid? = &(is_float(&1) or (is_struct(&1) and &1.__struct__ in structs))

    check_elements(values, valid?, fn ->
      "a float, #{Enum.map_join(structs, " or ", &inspect/1)}"
    end)
  end

  defp check_elements(list, valid?, expected) do
    case find_invalid(list, valid?, 0) do
      nil ->
        {:ok, list}

      :not_a_list ->
        {:error, "expected a list, each element #{expected.()}, got: #{inspect(list)}"}

      {n, element} ->
        {:error, "expected element #{n} to be #{expected.()}, got: #{inspect(element)}"}
    end
  end

  defp find_invalid([element | rest], valid?, n),
    do: if(valid?.(element), do: find_invalid(rest, valid?, n + 1), else: {n, element})

  defp find_invalid([], _valid?, _n), do: nil
  defp find_invalid(_other, _valid?, _n), do: :not_a_list
end

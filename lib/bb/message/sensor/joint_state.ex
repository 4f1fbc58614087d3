defmodule BB.Message.Sensor.JointState do
  @moduledoc """
  Positions, velocities and efforts of joints.

  The lists run in the order of `names`; one that is empty is not known. A revolute joint has rad, rad/s and N·m, a prismatic
  one m, m/s and N, each a float.
  """

  defstruct [:names, positions: [], velocities: [], efforts: []]

  @type t :: %__MODULE__{
          names: [atom()],
          positions: [float()],
          velocities: [float()],
          efforts: [float()]
        }

  @floats {:custom, __MODULE__, :check_elements, [:float]}

  use BB.Message,
    schema: [
      names: [
        type: {:custom, __MODULE__, :check_elements, [:atom]},
        required: true,
        type_doc: "list of `t:atom/0`",
        doc: "The joints."
      ],
      positions: [
        type: @floats,
        default: [],
        type_doc: "list of `t:float/0`",
        doc: "In rad or m."
      ],
      velocities: [
        type: @floats,
        default: [],
        type_doc: "list of `t:float/0`",
        doc: "In rad/s or m/s."
      ],
      efforts: [type: @floats, default: [], type_doc: "list of `t:float/0`", doc: "In N·m or N."]
    ]

  @doc false
  def check_elements(list, :float), do: check(list, list, 0, "a float", &is_float/1)
  def check_elements(list, :atom), do: check(list, list, 0, "an atom", &is_atom/1)

  defp check([element | rest], list, n, expected, valid?) do
    if valid?.(element),
      do: check(rest, list, n + 1, expected, valid?),
      else: {:error, "expected element #{n} to be #{expected}, got: #{inspect(element)}"}
  end

  defp check([], list, _n, _expected, _valid?), do: {:ok, list}

  defp check(_other, list, _n, expected, _valid?),
    do: {:error, "expected a list, each element #{expected}, got: #{inspect(list)}"}
end

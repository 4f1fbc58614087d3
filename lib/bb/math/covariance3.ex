defmodule BB.Math.Covariance3 do
  @moduledoc """
  The covariance of three quantities: a symmetric 3 × 3 matrix, with its nine floats row by row in
  `m`.

  Messages use it for the uncertainty of a vector or an orientation, such as those of
  `BB.Message.Sensor.Imu`:

      iex> BB.Math.Covariance3.diagonal([0.1, 0.2, 0.3])
      %BB.Math.Covariance3{m: {0.1, 0.0, 0.0, 0.0, 0.2, 0.0, 0.0, 0.0, 0.3}}

  As in ROS, a covariance of zeros is unknown, and a first element of -1 means that the quantity
  itself is unknown, see `unavailable/0`.
  """

  alias BB.Math.{Quaternion, Vec3}

  @enforce_keys [:m]
  defstruct [:m]

  @type t :: %__MODULE__{
          m: {float(), float(), float(), float(), float(), float(), float(), float(), float()}
        }

  @doc """
  Creates a covariance from a list of nine numbers, row by row, or of three rows of three numbers.

  Raises `ArgumentError` for a list of another length.

      iex> alias BB.Math.Covariance3
      iex> Covariance3.new([[1, 2, 3], [2, 4, 5], [3, 5, 6]])
      Covariance3.new([1, 2, 3, 2, 4, 5, 3, 5, 6])
  """
  @spec new([number()] | [[number()]]) :: t()
  def new([[_, _, _], [_, _, _], [_, _, _]] = rows), do: new(Enum.concat(rows))

  def new(elements) when is_list(elements) do
    if length(elements) == 9 and Enum.all?(elements, &is_number/1) do
      %__MODULE__{m: elements |> Enum.map(&:erlang.float/1) |> List.to_tuple()}
    else
      raise ArgumentError, "expected a list of 9 numbers, got: #{inspect(elements)}"
    end
  end

  @doc "Returns the covariance of zeros, which is an unknown one."
  @spec zero() :: t()
  def zero, do: diagonal([0, 0, 0])

  @doc "Returns the covariance with variances of one and without correlation."
  @spec identity() :: t()
  def identity, do: diagonal([1, 1, 1])

  @doc """
  Returns the covariance with the variances of a list and without correlation.

  Raises `ArgumentError` for a list of another length than three.
  """
  @spec diagonal([number()]) :: t()
  def diagonal([xx, yy, zz]), do: new([xx, 0, 0, 0, yy, 0, 0, 0, zz])

  def diagonal(variances),
    do: raise(ArgumentError, "expected a list of 3 numbers, got: #{inspect(variances)}")

  @doc "Returns the covariance with three variances and without correlation."
  @spec diagonal(number(), number(), number()) :: t()
  def diagonal(xx, yy, zz), do: diagonal([xx, yy, zz])

  @doc "Returns the covariance of an unknown quantity: -1, then zeros."
  @spec unavailable() :: t()
  def unavailable, do: diagonal([-1, 0, 0])

  @doc """
  Returns whether the covariance is that of an unknown quantity.

      iex> BB.Math.Covariance3.unavailable?(BB.Math.Covariance3.unavailable())
      true
      iex> BB.Math.Covariance3.unavailable?(BB.Math.Covariance3.identity())
      false
  """
  @spec unavailable?(t()) :: boolean()
  def unavailable?(%__MODULE__{m: m}), do: elem(m, 0) == -1.0

  @doc "Returns the element in `row` and `column`, each from 0 to 2."
  @spec get(t(), 0..2, 0..2) :: float()
  def get(%__MODULE__{m: m}, row, column) when row in 0..2 and column in 0..2,
    do: elem(m, 3 * row + column)

  @doc "Returns the element in `row` and `column`. Another name of `get/3`."
  @spec at(t(), 0..2, 0..2) :: float()
  def at(%__MODULE__{} = covariance, row, column), do: get(covariance, row, column)

  @doc "Returns the nine elements, row by row."
  @spec to_list(t()) :: [float()]
  def to_list(%__MODULE__{m: m}), do: Tuple.to_list(m)

  @doc """
  Rotates the covariance to other axes. `rotation` transforms vectors from the old axes to the
  new.

      iex> alias BB.Math.{Covariance3, Quaternion, Vec3}
      iex> quarter = Quaternion.from_axis_angle(Vec3.unit_z(), :math.pi() / 2)
      iex> turned = Covariance3.rotate(Covariance3.diagonal([1, 2, 3]), quarter)
      iex> for i <- 0..2, do: Float.round(Covariance3.get(turned, i, i), 12)
      [2.0, 1.0, 3.0]
  """
  @spec rotate(t(), Quaternion.t()) :: t()
  def rotate(%__MODULE__{} = covariance, %Quaternion{} = rotation),
    do: covariance |> rotate_rows(rotation) |> transpose() |> rotate_rows(rotation)

  # M · Rᵀ: each row is rotated like a vector.
  defp rotate_rows(%__MODULE__{m: m}, rotation) do
    m
    |> Tuple.to_list()
    |> Enum.chunk_every(3)
    |> Enum.flat_map(&Vec3.to_list(Quaternion.rotate_vector(rotation, Vec3.from_list(&1))))
    |> new()
  end

  defp transpose(%__MODULE__{m: {a, b, c, d, e, f, g, h, i}}),
    do: %__MODULE__{m: {a, d, g, b, e, h, c, f, i}}
end

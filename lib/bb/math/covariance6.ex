defmodule BB.Math.Covariance6 do
  @moduledoc """
  The covariance of a pose or a twist: a symmetric 6 × 6 matrix, with its 36 floats row by row in
  `m`.

  Messages of estimators use it, such as `BB.Message.Estimator.Pose`. The order is that of ROS: x,
  y, z, then the rotations about x, y and z.

      iex> alias BB.Math.{Covariance3, Covariance6}
      iex> covariance = Covariance6.diagonal([1, 2, 3, 4, 5, 6])
      iex> Covariance6.angular(covariance)
      Covariance3.diagonal([4, 5, 6])
  """

  alias BB.Math.Covariance3

  @enforce_keys [:m]
  defstruct [:m]

  @type t :: %__MODULE__{m: tuple()}

  @doc """
  Creates a covariance from a list of 36 numbers, row by row, or of six rows of six numbers.

  Raises `ArgumentError` for another length.
  """
  @spec new([number()] | [[number()]]) :: t()
  def new([row | _] = rows) when is_list(row) do
    if length(rows) == 6 and Enum.all?(rows, &match?([_, _, _, _, _, _], &1)),
      do: new(Enum.concat(rows)),
      else: raise(ArgumentError, "expected six rows of 6 numbers, got: #{inspect(rows)}")
  end

  def new(elements) when is_list(elements) do
    if length(elements) == 36 and Enum.all?(elements, &is_number/1) do
      %__MODULE__{m: elements |> Enum.map(&:erlang.float/1) |> List.to_tuple()}
    else
      raise ArgumentError, "expected a list of 36 numbers, got: #{inspect(elements)}"
    end
  end

  @doc "Returns the covariance of zeros, which is an unknown one."
  @spec zero() :: t()
  def zero, do: diagonal([0, 0, 0, 0, 0, 0])

  @doc "Returns the covariance with variances of one and without correlation."
  @spec identity() :: t()
  def identity, do: diagonal([1, 1, 1, 1, 1, 1])

  @doc """
  Returns the covariance with six variances and without correlation.

  Raises `ArgumentError` for a list of another length than six.
  """
  @spec diagonal([number()]) :: t()
  def diagonal([_, _, _, _, _, _] = variances) do
    rows = Enum.with_index(variances)
    new(for {v, row} <- rows, column <- 0..5, do: if(row == column, do: v, else: 0))
  end

  def diagonal(variances),
    do: raise(ArgumentError, "expected a list of 6 numbers, got: #{inspect(variances)}")

  @doc "Combines the covariances of a linear and an angular part that are not correlated."
  @spec from_parts(Covariance3.t(), Covariance3.t()) :: t()
  def from_parts(%Covariance3{} = linear, %Covariance3{} = angular) do
    new(
      for row <- 0..5, column <- 0..5 do
        cond do
          row < 3 and column < 3 -> Covariance3.get(linear, row, column)
          row > 2 and column > 2 -> Covariance3.get(angular, row - 3, column - 3)
          true -> 0.0
        end
      end
    )
  end

  @doc "Returns the covariance of x, y and z."
  @spec linear(t()) :: Covariance3.t()
  def linear(%__MODULE__{} = covariance), do: block(covariance, 0)

  @doc "Returns the covariance of the rotations."
  @spec angular(t()) :: Covariance3.t()
  def angular(%__MODULE__{} = covariance), do: block(covariance, 3)

  @doc "Returns the element in `row` and `column`, each from 0 to 5."
  @spec get(t(), 0..5, 0..5) :: float()
  def get(%__MODULE__{m: m}, row, column) when row in 0..5 and column in 0..5,
    do: elem(m, 6 * row + column)

  @doc "Returns the element in `row` and `column`. Another name of `get/3`."
  @spec at(t(), 0..5, 0..5) :: float()
  def at(%__MODULE__{} = covariance, row, column), do: get(covariance, row, column)

  @doc "Returns the 36 elements, row by row."
  @spec to_list(t()) :: [float()]
  def to_list(%__MODULE__{m: m}), do: Tuple.to_list(m)

  defp block(covariance, from) do
    Covariance3.new(
      for row <- 0..2, column <- 0..2, do: get(covariance, from + row, from + column)
    )
  end
end

defmodule BB.Parameter.Reference do
  @moduledoc """
  A reference to a parameter, in the place of a value. Pure. Use it in a robot's declaration,
  for a whole option of a component, or for a field of a transmission, a limit, an origin or an
  axis:

      sensor :imu, {BB.Sensor.Mpu6050, bus: "i2c-1", rate: param([:imu, :rate])}

  The field `expected_unit_type` is the unit that the option demands, if its type is one of
  `BB.Unit.Option`, and `nil` otherwise.
  """

  @enforce_keys [:path]
  defstruct [:path, :expected_unit_type]

  @typedoc "The path of a parameter, such as `[:imu, :rate]`."
  @type path :: [atom(), ...]

  @type t :: %__MODULE__{path: path(), expected_unit_type: atom() | String.t() | nil}

  @doc """
  Returns a reference to the parameter at `path`, a list of at least one atom.

      iex> import BB.Parameter.Reference
      iex> param([:imu, :rate])
      %BB.Parameter.Reference{path: [:imu, :rate]}
  """
  @spec param(path()) :: t()
  def param([first | rest] = path) when is_atom(first) and is_list(rest) do
    if Enum.all?(rest, &is_atom/1), do: %__MODULE__{path: path}, else: raise_path(path)
  end

  defp raise_path(path) do
    raise ArgumentError,
          "expected the path of a parameter, such as param([:imu, :rate]), " <>
            "got: param(#{inspect(path)})"
  end

  @doc """
  Returns the paths to which the values of a keyword list or a map refer, each once.

      iex> import BB.Parameter.Reference
      iex> BB.Parameter.Reference.paths(rate: param([:imu, :rate]), bus: "i2c-1")
      [[:imu, :rate]]
  """
  @spec paths(Enumerable.t() | nil) :: [path()]
  def paths(nil), do: []

  def paths(fields),
    do: for({_key, %__MODULE__{path: path}} <- fields, uniq: true, do: path)

  @doc """
  Replaces the references in a keyword list or a map by the results of `value`.

  A reference itself is replaced too; any other term is returned as it is.

      iex> import BB.Parameter.Reference
      iex> options = [rate: param([:imu, :rate]), bus: "i2c-1"]
      iex> BB.Parameter.Reference.resolve(options, fn [:imu, :rate] -> 100 end)
      [rate: 100, bus: "i2c-1"]
  """
  @spec resolve(term(), (path() -> term())) :: term()
  def resolve(%__MODULE__{path: path}, value), do: value.(path)
  def resolve(fields, value) when is_list(fields), do: Enum.map(fields, &field(&1, value))

  def resolve(fields, value) when is_map(fields) and not is_struct(fields),
    do: Map.new(fields, &field(&1, value))

  def resolve(other, _value), do: other

  @doc "Returns the first reference inside a value that is no reference itself, or `nil`."
  @spec buried(term()) :: t() | nil
  def buried(%__MODULE__{}), do: nil
  def buried(value), do: find(value)

  defp find(%__MODULE__{} = reference), do: reference
  defp find([head | tail]), do: find(head) || find(tail)
  defp find(value) when is_tuple(value), do: value |> Tuple.to_list() |> find()
  defp find(value) when is_map(value), do: value |> :maps.to_list() |> find()
  defp find(_value), do: nil

  defp field({key, %__MODULE__{path: path}}, value), do: {key, value.(path)}
  defp field(other, _value), do: other
end

defmodule BB.Parameter.Reference do
  @moduledoc """
  A parameter in the place of a value: `rate: param([:imu, :rate])`. Pure.

  It stands for a whole option of a component, or for a field of a transmission, a limit, an origin or an axis.
  """

  @enforce_keys [:path]
  defstruct [:path]

  @type t :: %__MODULE__{path: BB.Parameter.path()}

  @doc """
  Refers to the parameter at `path`.

      iex> import BB.Parameter.Reference
      iex> param([:imu, :rate])
      %BB.Parameter.Reference{path: [:imu, :rate]}
  """
  @spec param(BB.Parameter.path()) :: t()
  def param([_ | _] = path) do
    if Enum.all?(path, &is_atom/1), do: %__MODULE__{path: path}, else: refuse(path)
  end

  def param(other), do: refuse(other)

  defp refuse(other) do
    raise ArgumentError,
          "param takes the path of a parameter, such as param([:imu, :rate]), got: param(#{inspect(other)})"
  end

  @doc """
  The paths to which the values of a keyword list or a map refer, each once; `nil` refers to none.

      iex> import BB.Parameter.Reference
      iex> BB.Parameter.Reference.paths(rate: param([:imu, :rate]), bus: "i2c-1")
      [[:imu, :rate]]
  """
  @spec paths(Enumerable.t() | nil) :: [BB.Parameter.path()]
  def paths(nil), do: []

  def paths(fields),
    do: for({_key, %__MODULE__{path: path}} <- fields, uniq: true, do: path)

  @doc """
  A keyword list or a map with values in the place of references, looked up by `value`. A value that is itself a
  reference is replaced too; anything else is returned as it is.

      iex> import BB.Parameter.Reference
      iex> BB.Parameter.Reference.resolve([rate: param([:imu, :rate]), bus: "i2c-1"], fn [:imu, :rate] -> 100 end)
      [rate: 100, bus: "i2c-1"]
  """
  @spec resolve(term(), (BB.Parameter.path() -> term())) :: term()
  def resolve(%__MODULE__{path: path}, value), do: value.(path)
  def resolve(fields, value) when is_list(fields), do: Enum.map(fields, &field(&1, value))

  def resolve(fields, value) when is_map(fields) and not is_struct(fields),
    do: Map.new(fields, &field(&1, value))

  def resolve(other, _value), do: other

  @doc "The first reference that is deeper inside a value than it may stand, `nil` when there is none."
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
